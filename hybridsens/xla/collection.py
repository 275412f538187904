"""Python's collection of garbage, put off while a program is traced.

A trace keeps nearly all that it makes. To look through it for garbage again and again takes a tenth of the time.
"""

import contextlib
import gc
from collections.abc import Iterator


@contextlib.contextmanager
def collection_put_off() -> Iterator[None]:
    """Nothing is collected inside, unless somebody else's code asks for it; afterwards all is as it was."""
    was_on = gc.isenabled()
    gc.disable()
    try:
        yield
    finally:
        if was_on:
            gc.enable()
