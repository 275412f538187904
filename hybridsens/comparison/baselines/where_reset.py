"""Fixed steps with the reset inside a `where`: automatic differentiation holds every impact's time constant."""

from ...mechanics.scene import AbstractScene, State
from ..naive import naive_motion
from .motion import BaselineMotion


def where_reset(
    scene: AbstractScene, state: State, *, t0=0.0, t1, ts=None, running_cost=None, steps: int = 10_000
) -> BaselineMotion:
    """Motion in `steps` equal steps, see `naive_motion`: v+ = where(gap < 0 and closing, reset, v).

    Raises: NotImplementedError if states at `ts` are asked for, ValueError if `steps` is below 1.
    """
    if ts is not None:
        raise NotImplementedError("the fixed-step loop keeps no states at `ts`")
    motion = naive_motion(scene, state, t0=t0, t1=t1, steps=steps, running_cost=running_cost)
    return BaselineMotion(motion.final, motion.cost)
