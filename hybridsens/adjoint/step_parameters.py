"""Which parameters a step depends on: the weights that act at events alone, say, are in no step of the solver."""

from typing import Any

import equinox as eqx
import jax
from jax.interpreters import partial_eval

from ..flat_system import AbstractFlatSystem, Mode


def in_steps(system: AbstractFlatSystem, mode: Mode, t, x) -> Any:
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
