"""What a scene or a system says of itself."""

import inspect


def about(of: type) -> str:
    """The first line of its module: what it is; its own text where the module has none."""
    module = inspect.getmodule(of)
    return ((inspect.getdoc(module) if module is not None else None) or text(of)).partition("\n")[0]


def text(of: type) -> str:
    """The text of a class; empty where it has only the signature that Python puts in its place."""
    found = inspect.getdoc(of) or ""
    return "" if found.startswith(f"{of.__name__}(") else found
