"""Diffrax events with a root finder: the best that plain autodiff does, exact but for dense output."""

from functools import partial
from typing import Unpack

import optimistix as optx

from ...mechanics.scene import AbstractScene, State
from .event_chain import Asked, diffrax_solve, event_chain, first_event
from .motion import BaselineMotion


def events_at_root(
    scene: AbstractScene, state: State, *, tolerance: float = 1e-8, max_events: int = 64, **asked: Unpack[Asked]
) -> BaselineMotion:
    """Motion whose events are placed by Newton's method on the solver's dense output, and differentiated through it.

    `tolerance` is both rtol and atol of the error control. A motion with more than `max_events` events is NaN.
    """
    event = first_event(optx.Newton(rtol=1e-10, atol=1e-10))
    solve = partial(diffrax_solve, event=event)
    return event_chain(scene, state, asked, solve, tolerance, max_events)
