"""`hybridsens scenes`: what there is to run."""

import inspect

from ..scenes import SCENES


def scenes() -> None:
    """List the ready-made scenes."""
    width = max(map(len, SCENES))
    for name, scene in SCENES.items():
        about = inspect.getdoc(inspect.getmodule(scene)) or ""
        print(f"{name:<{width}}  {about.partition(chr(10))[0]}")
