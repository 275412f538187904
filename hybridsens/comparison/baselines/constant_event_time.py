"""Events at the right time, but with that time held constant: `stop_gradient` where (T5) belongs."""

from typing import Unpack

import optimistix as optx
from jax import lax

from ...mechanics.scene import AbstractScene, State
from .event_chain import Asked, diffrax_solve, event_chain, first_event
from .motion import BaselineMotion


def constant_event_time(
    scene: AbstractScene, state: State, *, tolerance: float = 1e-8, max_events: int = 64, **asked: Unpack[Asked]
) -> BaselineMotion:
    """Motion whose value is right and whose variations lack (R_x f- + R_t - f+) d t_k of (T6).

    `tolerance` is both rtol and atol of the error control. A motion with more than `max_events` events is NaN.
    """
    event = first_event(optx.Newton(rtol=1e-10, atol=1e-10))

    def solve(system, start, t1, *settings):
        located = diffrax_solve(system, start, t1, *settings, event=event)
        assert located.ts is not None
        return diffrax_solve(system, start, lax.stop_gradient(located.ts[-1]), *settings)

    return event_chain(scene, state, asked, solve, tolerance, max_events)
