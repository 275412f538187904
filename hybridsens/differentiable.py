"""A hybrid system's motion with its exact gradient: the segment loop, and the backward pass as its custom VJP."""

import equinox as eqx
import jax

from .adjoint.methods import AbstractGradientMethod, Replay
from .passes import BackwardOptions, Options, Problem, go_back, go_forward
from .reported import Reported, report
from .validation.direction import FORWARD_OVER_REVERSE, forward_only
from .xla.batches import map_batch_on_cpu
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


def _forward(problem: Problem, options: Options) -> tuple[Reported, Packed]:
    """Report and full record. A CPU's batch keeps no records: `_backward` runs its elements again."""
    dynamic, static = eqx.partition((problem, options), eqx.is_array)
    room = options.method.max_events
    go = lambda dynamic: go_forward(*eqx.combine(dynamic, static))

    def element(dynamic):
        motion, samples = go(dynamic)
        return report(motion, samples, room), pack((motion, samples))

    def unbatched(dynamic):
        packed = in_one_kernel(go)(dynamic)
        motion, samples = packed.unpack()
        return report(motion, samples, room), packed

    return map_batch_on_cpu(element, unbatched)(dynamic)


def _backward(
    problem: Problem, options: Options, record: Packed, cotangent: Reported, way: BackwardOptions
) -> Problem:
    """Cotangents of the problem from those of the report (None where nothing depends on an entry)."""
    dynamic, static = eqx.partition((problem, options), eqx.is_array)

    def back(dynamic, motion, cotangent):
        problem, options = eqx.combine(dynamic, static)
        return go_back(problem, options, motion, cotangent.observed, way)

    def element(dynamic, record, cotangent):
        return back(dynamic, record.unpack()[0], cotangent), None

    def unbatched(dynamic, record, cotangent):
        return in_one_kernel(lambda *given: element(*given)[0])(dynamic, record, cotangent).unpack(), None

    def element_of_batch(batched, dynamic, record, cotangent):
        problem_batched, record_batched, _ = batched
        again = lambda: go_forward(*eqx.combine(dynamic, static))[0]
        if problem_batched and not record_batched:
            return back(dynamic, again(), cotangent), None
        if not problem_batched:
            return element(dynamic, record, cotangent)
        # A `lax.cond` on the way gives a batch axis to records that were not kept too: they are zeros, so never begun.
        kept = record.unpack()[0]
        return back(dynamic, jax.lax.cond(kept.begun, lambda: kept, again), cotangent), None

    return map_batch_on_cpu(element, unbatched, element_of_batch)(dynamic, record, cotangent)[0]
