"""`hybridsens scenes`: what there is to run."""

import inspect

from ..scenes import SCENES
from ..systems import SYSTEMS


def scenes() -> None:
    """List the ready-made scenes and hybrid systems."""
    width = max(map(len, [*SCENES, *SYSTEMS]))
    for heading, models in (("mechanical scenes", SCENES), ("hybrid systems", SYSTEMS)):
        print(f"{heading}:")
        for name, of in models.items():
            about = inspect.getdoc(inspect.getmodule(of)) or ""
            print(f"  {name:<{width}}  {about.partition(chr(10))[0]}")
