"""What a motion is made from and what comes out of it, on their way over the border of what is compiled.

Outside of it a derivative is refused in a mode that its method does not serve; a motion that failed is raised, and so
is a derivative that ran out of steps.
"""

from collections.abc import Callable
from typing import Any

import numpy as np

from .adjoint.methods import AbstractGradientMethod
from .out_of_steps import RERUN, ROOM, marked, raised_if_marked
from .outcome import Motion, answered
from .validation.direction import forward_only, reverse_only


def entering(given: Any, later: Any, dtype: Any, adjoint: AbstractGradientMethod, throw: bool | str) -> tuple:
    """What a motion is made from, times that no step depends on, whose derivatives need none, and the mark that goes in
    with them."""
    if not adjoint.forward_mode:
        given, later = reverse_only((given, later))
    given, mark = marked(given, dtype, _reason(adjoint)) if throw is True else (given, np.zeros((), dtype))
    return given, later, mark


def leaving(
    found: tuple[Motion, Any], given: Any, adjoint: AbstractGradientMethod, throw: bool | str,
    describe: Callable[[Any], str],
) -> Motion:  # fmt: skip
    """The motion, from it and the mark that comes out beside it."""
    motion, mark = found
    motion = answered(motion, throw, given, describe)
    if throw is True:
        motion = raised_if_marked(motion, mark, _reason(adjoint))
    return motion if adjoint.reverse_mode else forward_only(motion)


def _reason(adjoint: AbstractGradientMethod) -> str:
    return ROOM if adjoint.segment_room is None else RERUN
