"""A hybrid system's motion with its exact derivatives: the segment loop, the backward pass as its custom VJP, and the
tangents of both where they are differentiated forward."""

from collections.abc import Callable
from functools import partial
from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
from jax import lax

from .adjoint.methods import AbstractGradientMethod
from .forward.record import Motion
from .forward.short_record import is_whole, lengthened, shortened
from .observables import Observables
from .passes import BackwardOptions, Options, Problem, go_back, go_forward, vary_forward
from .reported import Reported, report
from .validation.direction import SECOND_DERIVATIVES, forward_only
from .xla.batches import Done, Mapped
from .xla.linear_map import LinearMap, tangent_types
from .xla.packed import Packed, pack
from .xla.single_kernel import in_one_kernel
from .xla.tracing import TracedOnce


class Record(NamedTuple):
    """What a derivative needs of a motion. One of the two is kept; the other is all zeros, so its `begun` is False."""

    short: Motion
    """Of an element of a batch: the first rows."""
    full: Packed
    """Of a motion by itself."""


def differentiable_motion(problem: Problem, options: Options, adjoint: AbstractGradientMethod) -> Reported:
    """Motion of a hybrid system from (t0, x0) to t1, differentiable in all of `problem`.

    In reverse mode, and forward over reverse; in forward mode; or in both: as the gradient method serves them.
    """
    problem = problem._replace(system=TracedOnce(problem.system))
    # JAX names the mesh that it finds where it traces a derivative rule. What it traced without a name would be traced
    # again there. Under `jax.disable_jit` a motion is compiled all the same: the primitives below are of traces.
    with jax.sharding.use_abstract_mesh(jax.sharding.get_abstract_mesh()), jax.disable_jit(False):
        if not adjoint.reverse_mode:  # nothing else would tell that a derivative is taken
            return _move(problem, options._replace(differentiated=True))[0]
        return (_solve_in_any_mode if adjoint.forward_mode else _solve_in_reverse)(problem, options, adjoint)


@eqx.filter_custom_vjp
def _solve_in_reverse(problem: Problem, options: Options, adjoint: AbstractGradientMethod) -> Reported:
    del adjoint
    return _move(problem, options)[0]


@_solve_in_reverse.def_fwd
def _solve_fwd(perturbed, problem, options, adjoint):
    del perturbed, adjoint
    return _move(problem, options._replace(differentiated=True))


@_solve_in_reverse.def_bwd
def _solve_bwd(record, cotangent, perturbed, problem, options, adjoint):
    backward_options = BackwardOptions(adjoint, perturbed.t0, perturbed.t1)
    return _backward(problem, options, backward_options, record, cotangent.observed)


@eqx.filter_custom_jvp
def _solve_in_any_mode(problem: Problem, options: Options, adjoint: AbstractGradientMethod) -> Reported:
    del adjoint
    return _move(problem, options)[0]


@_solve_in_any_mode.def_jvp
def _solve_in_any_mode_jvp(primals, tangents):
    """The tangent of a motion, as a linear map whose transpose is the way back."""
    problem, options, adjoint = primals
    (d_problem, *_) = tangents
    backward_options = BackwardOptions(adjoint, d_problem.t0 is not None, d_problem.t1 is not None)
    reported, record = _move(problem, options._replace(differentiated=True))

    # The map takes and returns lists of arrays: constants, the tangents of what is perturbed, those of `observed`.
    dynamic, static = eqx.partition((problem, options, backward_options, record), eqx.is_array)
    constants, constants_tree = jax.tree.flatten(dynamic)
    known = lambda constants: eqx.combine(constants_tree.unflatten(constants), static)
    d_leaves, d_tree = jax.tree.flatten(d_problem)
    observed_tree = jax.tree.structure(reported.observed)
    is_none = lambda x: x is None
    perturbed = [d is not None for d in jax.tree.leaves(d_problem, is_leaf=is_none)]

    # A tangent that was differentiated itself may not be transposed: that is refused in plain words.
    def forward(constants, d_leaves):
        problem, options, _, record = known(constants)
        d_observed = _from_record(vary_forward, (problem, options), record, d_tree.unflatten(d_leaves), directions=True)
        return observed_tree.flatten_up_to(forward_only(d_observed, SECOND_DERIVATIVES))

    def backward(constants, cotangents):
        problem, options, backward_options, record = known(constants)
        cotangent = observed_tree.unflatten(cotangents)
        problem_cotangent = _backward(problem, options, backward_options, record, cotangent)
        leaves = jax.tree.leaves(problem_cotangent, is_leaf=is_none)
        return [cotangent for cotangent, wanted in zip(leaves, perturbed, strict=True) if wanted]

    d_observed = LinearMap(forward, backward)(constants, d_leaves, tangent_types(reported.observed))
    return reported, jax.tree.map(lambda _: None, reported)._replace(observed=observed_tree.unflatten(d_observed))


@eqx.filter_jit  # JAX traces a function with a derivative rule, and then its rule: the second time it is looked up
def _move(problem: Problem, options: Options) -> tuple[Reported, Record]:
    """Report and record. Of a batch on a CPU, where all its records would be large, only short ones are kept."""
    dynamic, static = eqx.partition((problem, options), eqx.is_array)
    room = options.settings.max_events
    go = lambda dynamic: go_forward(*eqx.combine(dynamic, static))

    def element(dynamic):
        motion, samples = go(dynamic)
        return Done(report(motion, samples, room), shortened(motion), pack((motion, samples)))

    def unbatched(dynamic):
        packed = in_one_kernel(go)(dynamic)
        motion, samples = packed.unpack()
        none = jax.tree.map(lambda s: jnp.zeros(s.shape, s.dtype), jax.eval_shape(shortened, motion))
        return Done(report(motion, samples, room), none, packed)

    def vary(arguments, done, tangents):
        """Forward mode, and the forward pass of forward over reverse. A record does not vary: it is followed anew."""
        asked, record = eqx.combine(arguments[0], static), Record(done.kept, done.residuals)
        varied = _from_record(vary_forward, asked, record, tangents[0][0], directions=True)
        return jax.tree.map(lambda _: None, done.result)._replace(observed=varied)

    done = Mapped(element, unbatched, vary=vary)(dynamic)
    return done.result, Record(done.kept, done.residuals)


def _backward(
    problem: Problem, options: Options, backward_options: BackwardOptions, record: Record, cotangent: Observables
) -> Problem:
    """Cotangents of the problem (None where nothing depends on an entry). They may be differentiated forward, but not
    transposed."""
    asked = problem, options, backward_options
    return forward_only(_from_record(go_back, asked, record, cotangent), SECOND_DERIVATIVES)


def _from_record(function: Callable, asked: tuple, record: Record, given: Any, directions: bool = False) -> Any:
    """function(*asked, motion, given), also under `jax.vmap`, where `given` are cotangents or tangents.

    The motion is that of the record, or runs again where the record was not kept. With `directions`, an axis that
    `given` alone has, as of the columns of a Jacobian, runs in step: all directions share the steps of the motion."""
    dynamic, static = eqx.partition(asked, eqx.is_array)

    def of(motion, dynamic, given):
        return Done(function(*eqx.combine(dynamic, static), motion, given))

    def again(dynamic):  # the function gives the motion its tangents: to differentiate it here would be for nothing
        return go_forward(*eqx.combine(lax.stop_gradient(dynamic), static)[:2])[0]

    def element(dynamic, short, full, given):
        return of(full.unpack()[0], dynamic, given)

    def unbatched(dynamic, short, full, given):
        alone = lambda dynamic, full, given: of(full.unpack()[0], dynamic, given)
        return in_one_kernel(alone)(dynamic, full, given).unpack()

    def run_again(dynamic, short, full, given):
        return of(again(dynamic), dynamic, given)

    def from_kept(dynamic, short, full, given, full_batched):
        full = full.unpack()[0]
        motion = lax.cond(is_whole(short, full), lambda: lengthened(short, full), lambda: again(dynamic))
        if full_batched:  # a `lax.cond` around the motion gives an axis to the zeros too, or its elements were kept
            motion = lax.cond(full.begun, lambda: full, lambda: motion)
        return of(motion, dynamic, given)

    def choice(batched):
        problem_batched, short_batched, full_batched = batched[:3]
        if not problem_batched:
            return None  # the axis is of cotangents or directions alone
        return partial(from_kept, full_batched=full_batched) if short_batched or full_batched else run_again

    mapped = Mapped(element, unbatched, choice, frozenset({3} if directions else ()))
    with jax.disable_jit(False):
        return mapped(dynamic, *record, given).result
