"""A hybrid system's motion with its exact gradient: the segment loop, and the backward pass as its custom VJP."""

from functools import partial
from typing import NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp

from .adjoint.methods import AbstractGradientMethod, Replay
from .forward.record import Motion
from .forward.short_record import is_whole, lengthened, shortened
from .passes import BackwardOptions, Options, Problem, go_back, go_forward
from .reported import Reported, report
from .validation.direction import FORWARD_OVER_REVERSE, forward_only
from .xla.batches import Done, map_batch_on_cpu
from .xla.packed import Packed, pack
from .xla.single_kernel import in_one_kernel
from .xla.trace_cache import TracedOnce


def differentiable_motion(
    problem: Problem, options: Options, adjoint: AbstractGradientMethod | None = None
) -> Reported:
    """Motion of a hybrid system from (t0, x0) to t1, differentiable in all of `problem`.

    In reverse mode, and forward over reverse, or in forward mode where the gradient method serves that.
    """
    problem = problem._replace(system=TracedOnce(problem.system))
    # JAX traces the rule below under the mesh that it finds, named; were it not named here, all would be traced twice.
    with jax.sharding.use_abstract_mesh(jax.sharding.get_abstract_mesh()):
        if adjoint is not None and adjoint.forward_mode:
            return _forward(problem, options)[0]
        return _solve_in_reverse(problem, options, adjoint or Replay())


@eqx.filter_custom_vjp
def _solve_in_reverse(problem: Problem, options: Options, adjoint: AbstractGradientMethod) -> Reported:
    del adjoint
    return _forward(problem, options)[0]


@_solve_in_reverse.def_fwd
def _solve_fwd(perturbed, problem, options, adjoint):
    del perturbed, adjoint
    return _forward(problem, options)


@_solve_in_reverse.def_bwd
def _solve_bwd(motion, cotangent, perturbed, problem, options, adjoint):
    way = BackwardOptions(adjoint, perturbed.t0, perturbed.t1)
    return forward_only(_backward(problem, options, motion, cotangent, way), FORWARD_OVER_REVERSE)


class _Record(NamedTuple):
    """What the way back needs of a motion. Both are zeros, of a motion not begun, where they were not kept."""

    short: Motion
    """Of an element of a batch: the first rows."""
    full: Packed
    """Of a motion by itself."""


def _forward(problem: Problem, options: Options) -> tuple[Reported, _Record]:
    """Report and record. Of a batch on a CPU, where all its records would be large, only short ones are kept."""
    dynamic, static = eqx.partition((problem, options), eqx.is_array)
    room = options.method.max_events
    go = lambda dynamic: go_forward(*eqx.combine(dynamic, static))

    def element(dynamic):
        motion, samples = go(dynamic)
        return Done(report(motion, samples, room), shortened(motion), pack((motion, samples)))

    def unbatched(dynamic):
        packed = in_one_kernel(go)(dynamic)
        motion, samples = packed.unpack()
        none = jax.tree.map(lambda s: jnp.zeros(s.shape, s.dtype), jax.eval_shape(shortened, motion))
        return Done(report(motion, samples, room), none, packed)

    done = map_batch_on_cpu(element, unbatched)(dynamic)
    return done.result, _Record(done.kept, done.residuals)


def _backward(
    problem: Problem, options: Options, record: _Record, cotangent: Reported, way: BackwardOptions
) -> Problem:
    """Cotangents of the problem from those of the report (None where nothing depends on an entry)."""
    dynamic, static = eqx.partition((problem, options), eqx.is_array)

    def back(dynamic, motion, cotangent):
        problem, options = eqx.combine(dynamic, static)
        return go_back(problem, options, motion, cotangent.observed, way)

    def again(dynamic):
        return go_forward(*eqx.combine(dynamic, static))[0]

    def alone(dynamic, full, cotangent):
        return back(dynamic, full.unpack()[0], cotangent)

    def element(dynamic, short, full, cotangent):
        return Done(alone(dynamic, full, cotangent))

    def unbatched(dynamic, short, full, cotangent):
        return Done(in_one_kernel(alone)(dynamic, full, cotangent).unpack())

    def run_again(dynamic, short, full, cotangent):
        return Done(back(dynamic, again(dynamic), cotangent))

    def from_kept(dynamic, short, full, cotangent, *, full_batched):
        full = full.unpack()[0]
        motion = jax.lax.cond(is_whole(short, full), lambda: lengthened(short, full), lambda: again(dynamic))
        if full_batched:  # kept in forward mode; or zeros, to which a `lax.cond` on the way gave an axis
            motion = jax.lax.cond(full.begun, lambda: full, lambda: motion)
        return Done(back(dynamic, motion, cotangent))

    def choice(batched):
        problem_batched, short_batched, full_batched, _ = batched
        if not problem_batched:
            return None  # the axis is of the cotangents alone
        return partial(from_kept, full_batched=full_batched) if short_batched or full_batched else run_again

    return map_batch_on_cpu(element, unbatched, choice)(dynamic, *record, cotangent).result
