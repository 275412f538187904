"""Settings of a run."""

from typing import Any

import diffrax
import equinox as eqx

from .segment import Stepper
from .solver import FlowSize, prepare_solver


class Method(eqx.Module):
    """Settings of a run: what trades accuracy for time, and how much room there is."""

    solver: diffrax.AbstractSolver
    rtol: Any
    atol: Any
    max_events: int = eqx.field(static=True)
    max_steps: int = eqx.field(static=True)
    segment_steps: int | None = eqx.field(default=None, static=True)
    """Steps are not recorded, and no segment has more than this; None: all are recorded."""

    max_step: Any = None
    """Longest step; None for as long as the error control allows."""

    derivative_rtol: Any = None
    """Error allowed to a derivative in one step, relative; None for what the tolerances of the motion stand for, inf
    for no control."""

    def stepper(self, size: FlowSize) -> Stepper:
        """Solver and error control of the forward pass, for a flow of that size."""
        solver = prepare_solver(self.solver, self.rtol, self.atol, "lax", size)
        control = diffrax.PIDController(rtol=self.rtol, atol=self.atol, dtmax=self.max_step)
        return Stepper(solver, control, self.max_steps, self.segment_steps or self.max_steps)

    def replay_solver(self, size: FlowSize) -> diffrax.AbstractSolver:
        """The same solver where its steps are differentiated."""
        return prepare_solver(self.solver, self.rtol, self.atol, "bounded", size)
