"""A name that is not there: which one was meant?"""

import difflib
from collections.abc import Iterable


def did_you_mean(names: str | Iterable[str], known: Iterable[str]) -> str:
    """" Did you mean 'weight'?" for "wieght", to end a message with; empty if no known name is near."""
    names, known = [names] if isinstance(names, str) else list(names), list(known)
    near = [match for name in names for match in difflib.get_close_matches(name, known, n=1)]
    return f" Did you mean {', '.join(map(repr, dict.fromkeys(near)))}?" if near else ""
