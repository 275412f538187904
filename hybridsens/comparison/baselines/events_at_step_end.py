"""Diffrax events without a root finder: the reset happens at the end of the step that crossed the contact."""

from functools import partial
from typing import Unpack

from ...mechanics.scene import AbstractScene, State
from .event_chain import Asked, diffrax_solve, event_chain, first_event
from .motion import BaselineMotion


def events_at_step_end(
    scene: AbstractScene, state: State, *, tolerance: float = 1e-8, max_events: int = 64, **asked: Unpack[Asked]
) -> BaselineMotion:
    """Motion whose events happen at step ends, late by up to a step, and whose times have no derivative: d t_k = 0.

    `tolerance` is both rtol and atol of the error control. A motion with more than `max_events` events is NaN.
    """
    event = first_event(None)
    solve = partial(diffrax_solve, event=event)
    return event_chain(scene, state, asked, solve, tolerance, max_events)
