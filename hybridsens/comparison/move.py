"""One way to ask for a motion, of a mechanical scene or of any other hybrid system."""

from collections.abc import Callable
from typing import Any

from ..mechanics.trajectory import Trajectory
from ..simulate import simulate
from ..solution import Solution
from ..solve import solve
from ..system import AbstractHybridSystem


def move(model: Any, *start: Any, **settings: Any) -> Trajectory | Solution:
    """`hybridsens.solve` of a hybrid system, `hybridsens.simulate` of anything else; see there."""
    of: Callable = solve if isinstance(model, AbstractHybridSystem) else simulate
    return of(model, *start, **settings)
