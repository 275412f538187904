"""States at the times asked for: one more step of the solver, from the recorded step that spans the time.

Dense output is less exact than the steps themselves, and Diffrax has it in cubic form only for some solvers. A shorter
step is as exact as the recorded one, for any solver, and its derivative is that of a step.
"""

import diffrax
import equinox as eqx
import jax
import jax.numpy as jnp
from jax import lax
from jaxtyping import Array, Float

from ..flat_system import AbstractFlatSystem
from ..numerics.batch_axes import batch_in_front
from ..numerics.no_time import in_no_time
from ..numerics.tolerances import jump_window
from .record import Motion, is_jump, segment, segment_end
from .solver import one_step
from .tangent import push


def past_coincidences(system: AbstractFlatSystem, motion: Motion, ts: Float[Array, "sample"]) -> Float[Array, "sample"]:
    """`ts`, where one at which a jump time and an event fall together becomes the first moment after both, and one at
    a jump time that the motion starts at becomes its start.

    While the clock passes a jump time nothing is recorded, and the event may stand on either side of it: at the time
    itself the state after it would not be found."""
    if system.jump_times() is None:
        return ts
    rows, steps = motion.events.rows, motion.steps
    jump = is_jump(rows.number)
    # How many jump times, and how many events, there are up to each row: a sample need not look at every row.
    up_to = [jnp.cumsum(jnp.append(0, kind)) for kind in (jump, ~jump & ~rows.decision.silent)]

    def moved(t):
        first = jnp.searchsorted(rows.states.time, t - jump_window(t))
        beyond = jnp.searchsorted(rows.states.time, t + jump_window(t), side="right")
        coincide = jnp.all(jnp.stack([count[beyond] > count[first] for count in up_to]))
        last = jnp.searchsorted(steps.t, t + jump_window(t), side="right") - 1
        after = steps.t[jnp.clip(last, 0, steps.count)]
        return jnp.where(coincide, jnp.maximum(after - t, 0), 0)

    later = lax.stop_gradient(jnp.maximum(ts + jax.vmap(moved)(ts), _start(motion)))
    return ts + lax.stop_gradient(lax.cummax(later) - ts)  # in the order in which they came


def _start(motion: Motion):
    """Where the motion began. The clock of one that has not begun stands there."""
    return jnp.where(motion.steps.count > 0, motion.steps.t[0], motion.t)


def sample_states(
    system: AbstractFlatSystem, solver: diffrax.AbstractSolver, motion: Motion, ts: Float[Array, "sample"]
) -> Float[Array, "sample state"]:
    """States at `ts`; at an event, the state just after it. Differentiable in the recorded grid and in ts, in forward
    mode alone: directions share what they have in common."""
    return jax.vmap(lambda t: _at(system, solver, motion, t)[1])(ts)


def sample_rates(
    system: AbstractFlatSystem, solver: diffrax.AbstractSolver, motion: Motion, ts: Float[Array, "sample"]
) -> Float[Array, "sample state"]:
    """Rates of the states at `ts`, by which samples move with their times."""
    return jax.vmap(lambda t: system.flow(*_at(system, solver, motion, t)))(ts)


def _at(system: AbstractFlatSystem, solver, motion: Motion, t):
    """Time, state and mode of a sample; a jump time belongs to what was before.

    Where the grid moves, the step to the sample keeps its length, and the flow leads back to the time asked for. What a
    step's error changes by with its length would be multiplied by how far the grid moves, which may be far."""
    ends = motion.events.steps
    passed = jnp.arange(ends.shape[0]) < motion.events.count
    k = jnp.searchsorted(motion.steps.t, t, side="right") - 1
    k = jnp.clip(k, 0, motion.steps.count)
    j = jnp.sum(passed & (ends <= k))
    mode, _, _ = segment(motion, j)
    t = t - lax.stop_gradient(jnp.maximum(t - segment_end(motion, j), 0))
    start = motion.steps.t[k]
    moved = t + (start - lax.stop_gradient(start))
    x = _shorter_step(motion.begun, solver, system, mode, start, moved, motion.steps.x[k])
    return t, x + in_no_time(_mean_flow, moved, t, system, moved, t, x, mode), mode


def _mean_flow(system: AbstractFlatSystem, t0, t1, x, mode):
    """The flow on the way from (t0, x) to t1 = t0, f + (t1 - t0) f' / 2: right in second derivatives too."""

    def change(system, t, x, mode):
        flow = lambda t, x: system.flow(t, x, mode)
        return jax.jvp(flow, (t, x), (jnp.ones_like(t), flow(t, x)))[1]

    return system.flow(t0, x, mode) + in_no_time(change, t0, t1, system, t0, x, mode) / 2


@eqx.filter_custom_jvp
def _shorter_step(begun, solver, *point):
    del begun
    return batch_in_front(one_step(solver, *point))


@_shorter_step.def_jvp
def _shorter_step_jvp(primals, tangents):
    (begun, solver, *point), (_, _, *directions) = primals, tangents
    x, dx = push(lambda *point: one_step(solver, *point), begun, point, directions)
    return batch_in_front(x), dx
