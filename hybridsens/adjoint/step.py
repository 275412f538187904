"""One recorded step, as a gradient method is given it, what it makes of a costate, and which parameters it depends on:
the weights that act at events alone, say, are in no step of the solver."""

from typing import Any, NamedTuple

import diffrax
import equinox as eqx
import jax
from jax.interpreters import partial_eval
from jaxtyping import Array, Float

from ..flat_system import AbstractFlatSystem, Mode
from ..forward.solver import one_step


class RecordedStep(NamedTuple):
    """One step of the solver, x1 = Phi(theta, t0, x0), in a mode that does not change within it.

    The state is one vector: all of the user's state, and the running cost after it.
    """

    parameters: Any
    """theta: those floating point leaves of the system that its flow depends on."""
    static: Any
    """The rest of the system."""
    mode: Any
    """The mode that the step is taken in."""
    t0: Float[Array, ""]
    """Where it begins."""
    t1: Float[Array, ""]
    """Where it ends."""
    x0: Float[Array, "state"]
    """The state at its beginning."""
    solver: diffrax.AbstractSolver
    """The motion's own."""
    controlled: bool = False
    """Whether an estimate of the error of what is returned is wanted: steps are then cut until it is small."""

    def system(self, parameters: Any) -> Any:
        """The system with these parameters."""
        return eqx.combine(parameters, self.static)

    def flow(self, parameters: Any, t: Float[Array, ""], x: Float[Array, "state"]) -> Float[Array, "state"]:
        """f(theta, t, x) in the mode of this step."""
        return self.system(parameters).flow(t, x, self.mode)

    def advance(self, parameters: Any, x0: Float[Array, "state"], t: Float[Array, ""]) -> Float[Array, "state"]:
        """The state at t in [t0, t1], by one step of the motion's own solver from (t0, x0)."""
        return one_step(self.solver, self.system(parameters), self.mode, self.t0, t, x0)


class StepBack(NamedTuple):
    """What a costate becomes over one step."""

    total: Any
    """What the step adds to dJ/dtheta, of the structure of theta."""
    psi: Float[Array, "state"]
    """psi at its start."""
    total_error: Any = None
    """Estimated error of `total`; None where the method controls its error by itself."""
    psi_error: Any = None
    """Estimated error of `psi`; None as above."""


def step_parameter_mask(system: AbstractFlatSystem, mode: Mode, t, x) -> Any:
    """For each leaf of a system whether it is a floating point array that its flow or its projection depends on.

    Told from their traces. What stands in a loop or a branch counts if anything inside needs it; nothing that does
    matter is left out."""
    parameters, static = eqx.partition(system, eqx.is_inexact_array)

    def parts(parameters, t, x):
        system = eqx.combine(parameters, static)
        shorter = system.unconstrained(mode)
        flows = [of.flow(t, x, mode) for of in (system, *(() if shorter is None else shorter[1:]))]
        return flows, system.project(t, x, mode)

    trace = jax.make_jaxpr(parts)(parameters, t, x)
    _, needed = partial_eval.dce_jaxpr(trace.jaxpr, [True] * len(trace.out_avals))
    is_needed = iter(needed)
    return jax.tree.map(lambda leaf: eqx.is_inexact_array(leaf) and next(is_needed), system)
