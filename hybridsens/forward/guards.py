"""What guards tell at one instant: at the start of a segment, and where a step ended."""

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float, Int

from ..flat_system import StepEnds
from ..numerics.tolerances import MOST_RELAXED, closeness, rounding, time_resolution


class GuardsAtStart(eqx.Module):
    """What is known of the guards where a segment starts."""

    guard: Float[Array, "guard"]
    rate: Float[Array, "guard"]
    noise: Float[Array, "guard"]
    """Rounding to be granted to a guard that the segment starts on without a rate, and to one that an event left below
    zero; 0 for every other guard."""
    leaving: Bool[Array, "guard"]
    """Guards that the segment starts on."""
    triggered: Bool[Array, "guard"]
    """Guards that are at or below zero and falling at the very start."""
    guard_jumped: Bool[Array, "guard"]
    """Guards that are farther below than their fall explains: an event, or a jump, put them there."""


def guards_at_start(system, t, x, mode) -> GuardsAtStart:
    """Tell guards that the segment leaves (it was just reset, or starts there) from guards that fire at once.

    A guard that is left starts at exactly 0 with a rate that is not negative, so its cubic has no root at the start, as
    that of the guard of (T4) has none."""
    guard, rate = system.guards_and_rates(t, x, mode)
    size, rate_size = scales_at(system, t, x, mode, guard)
    noise, rate_noise = closeness(x.dtype) * size, closeness(x.dtype) * rate_size
    triggered = (rate < -rate_noise) & (guard <= rounding(x.dtype) * size - time_resolution(t, 0) * rate)
    triggered &= guard < jnp.inf  # where the rate is infinite too, that comparison says nothing
    leaving = (guard <= noise) & ~triggered & (rate >= -rate_noise)
    lifting = leaving & (rate <= rate_noise)  # without a rate, only its acceleration carries it off
    guard_jumped = guard < -noise - time_resolution(t, MOST_RELAXED) * jnp.abs(rate)
    below = leaving & (guard < -rounding(x.dtype) * size)  # it takes a while to rise to zero: no crossing
    # Half of what counts as zero, and little more than it was below: what strikes there again is not too deep.
    granted = jnp.maximum(jnp.where(lifting, noise / 2, 0), jnp.where(lifting | below, -1.0001 * guard, 0))
    return GuardsAtStart(guard, rate, granted, leaving, triggered, guard_jumped)


def scales_at(system, t, x, mode, guard) -> tuple[Float[Array, "guard"], Float[Array, "guard"]]:
    """What the rounding of guards and of their rates is relative to at (t, x)."""
    size, rate_size = (jnp.broadcast_to(scale, guard.shape) for scale in system.scales(t, x, mode))
    return size, rate_size


def turning_at_zero(system, step: StepEnds, mode) -> tuple[Bool[Array, "guard"], Float[Array, "guard"]]:
    """Guards that turn at the end of a step on a zero that they do not pass, to what rounding can tell; and rounding
    of the guards there.

    A guard g that bends by g'' dips below its zero by g'^2 / (2 g''). Where rounding is more than that, as of
    1 - sin t at its double root, whether it falls through zero is chance: it does not, unless it does so later."""
    scales = system.turning_scales(step.t1, step.x1, mode)
    if scales is None:
        return jnp.zeros(step.guard1.shape, bool), jnp.zeros_like(step.guard1)
    rounded, rate_rounded = (rounding(step.guard1.dtype) * scale for scale in scales)
    bend = jnp.maximum(step.rate1 - step.rate0 - rate_rounded, 0) / (step.t1 - step.t0)  # 0 where it falls ever faster
    return (jnp.abs(step.guard1) <= rounded) & (step.rate1**2 < rounded * bend), rounded


def first_to_fall(candidates: Bool[Array, "guard"], guard, rate) -> tuple[Int[Array, ""], Float[Array, ""]]:
    """Which of the candidate guards passed zero first, and how long ago; -1 and -inf where there are no guards.

    guard / rate is the time since then; one that jumped below zero has a rate of -inf, and comes last."""
    if guard.shape[0] == 0:
        return jnp.array(-1), jnp.array(-jnp.inf, guard.dtype)
    since = jnp.where(candidates, guard / jnp.where(rate < 0, rate, 1), -jnp.inf)
    return jnp.argmax(since), jnp.max(since)
