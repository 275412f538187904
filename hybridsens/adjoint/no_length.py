"""Segments of no length: between two events at one instant, or before one at t0, or after one at t1.

They take no step and change no tangent and no costate. Where these are differentiated once more, the ends of the
segment move apart.
"""

from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool

from ..flat_system import AbstractFlatSystem, Mode
from ..forward.record import Motion, segment, segment_end, segment_start
from ..numerics.no_time import in_no_time
from ..observables import filled


def pull_in_no_time(
    system: AbstractFlatSystem, step_parameter_mask, ends: tuple[Array, Array], x, mode: Mode, psi
) -> tuple[Any, Array]:
    """What dJ/dtheta and the costate gain from t1 back to t0 = t1: (t1 - t0) f_theta^T psi and (t1 - t0) f_x^T psi."""

    def rate(system, t, x, mode, psi):
        parameters, static = eqx.partition(system, step_parameter_mask)
        flow = lambda parameters, x: eqx.combine(parameters, static).flow(t, x, mode)
        return jax.vjp(flow, parameters, x)[1](psi)

    return in_no_time(rate, *ends, system, ends[1], x, mode, psi)


def without_length(motion: Motion, j, t0) -> tuple[Bool[Array, ""], tuple[Array, Array], Array, Mode]:
    """Whether segment j has no length; where it begins and ends, its state, and its mode."""
    mode, first, last = segment(motion, j)
    ends = segment_start(motion, j, t0), segment_end(motion, j)
    place = jnp.minimum(j, motion.events.steps.shape[0] - 1)
    x = jnp.where(j < motion.events.count, motion.events.states.before[place], motion.x)
    return first == last, ends, x, mode


def push_no_length(system: AbstractFlatSystem, d_system, motion: Motion, j, t0, dx):
    """What a segment of no length adds to a tangent: (t1 - t0) (f_x dx + f_theta dtheta)."""
    is_empty, (start, end), x, mode = without_length(motion, j, t0)

    def rate(system, d_system, t, x, mode, dx):
        flow = lambda system, x: system.flow(t, x, mode)
        return filled(*eqx.filter_jvp(flow, (system, x), (d_system, dx)))

    return jnp.where(is_empty, in_no_time(rate, start, end, system, d_system, end, x, mode, dx), 0)


def pull_no_length(system: AbstractFlatSystem, step_parameter_mask, motion: Motion, j, t0, psi) -> tuple[Any, Array]:
    """What a segment of no length adds to dJ/dtheta and to a costate: (t1 - t0) f_theta^T psi and (t1 - t0) f_x^T psi.
    """
    is_empty, ends, x, mode = without_length(motion, j, t0)
    added = pull_in_no_time(system, step_parameter_mask, ends, x, mode, psi)
    return jax.tree.map(lambda leaf: jnp.where(is_empty, leaf, 0).astype(leaf.dtype), added)
