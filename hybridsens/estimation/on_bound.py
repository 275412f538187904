"""Which parameters a fit has driven onto their bounds, and whether the others are at their minimum there.

Bounds are kept by a transformation that is flat on them (`parameters.py`), so the optimizer comes close to a bound, and
its own measures of convergence do not see that it has arrived. They are asked anew, by the parameters themselves.
"""

import dataclasses

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float

from .growing import Growing
from .iterate import iterate
from .least_squares import at_minimum, compressed, linearise
from .optimizers import Method
from .problem import Problem

_OF_ERROR, _OF_SIZE = 1e-2, 1e-6
"""A parameter is on its bound within this part of its standard error, or of its size."""


def by_parameters(
    how: Method | Growing, problem: Problem, z
) -> tuple[Float[np.ndarray, "residual"], Float[np.ndarray, "residual parameter"]]:
    """Residuals and their derivative by the parameters p themselves, by the program that the iterations have compiled.

    Without bounds p = scale z, also where bounds would make p(z) flat. The scales are powers of two, so that no
    rounding moves p beyond its bound.
    """
    selection = problem.selection
    scale = np.exp2(np.floor(np.log2(selection.scale)))
    lower, upper = np.full_like(selection.lower, -np.inf), np.full_like(selection.upper, np.inf)
    free = dataclasses.replace(selection, lower=lower, upper=upper, scale=scale)
    r, jacobian = _linearised(how, dataclasses.replace(problem, selection=free), selection.to_values(z) / scale)
    return np.asarray(r), np.asarray(jacobian) / scale


def plain(problem: Problem) -> Problem:
    """The same with all residuals squared."""
    return eqx.tree_at(lambda p: p.robust, problem, jnp.asarray(jnp.inf))


def held_on_bound(problem: Problem, values, r, jacobian, sigmas_given: bool) -> Bool[np.ndarray, "parameter"]:
    """Which parameters are on a bound, beyond which the loss goes on falling.

    They are next to it, and a Newton step in that parameter alone, -(J^T r) / (J^T J), leads beyond it.
    """
    selection = problem.selection
    curvature = np.sum(jacobian**2, axis=0)
    seen = np.where(curvature > 0, curvature, np.inf)
    step = -(jacobian.T @ r) / seen
    noise = 1.0 if sigmas_given else np.sqrt(np.sum(r**2) / max(r.size - np.size(values), 1))
    near = np.maximum(_OF_ERROR * noise / np.sqrt(seen), _OF_SIZE * np.asarray(selection.scale))
    p, lower, upper = np.asarray(values), np.asarray(selection.lower), np.asarray(selection.upper)
    below, above = (p - lower <= near) & (p + step < lower), (upper - p <= near) & (p + step > upper)
    return below | above


def others_at_minimum(values, r, jacobian, held: Bool[np.ndarray, "parameter"]) -> bool:
    """Whether the parameters that are not held are at a minimum, if those held stay where they are."""
    if held.all():
        return True
    p = np.asarray(values)[~held]
    size = np.where(p == 0, 1.0, np.abs(p))
    short, slope = compressed(jnp.asarray(r), jnp.asarray(jacobian[:, ~held] * size))
    return bool(at_minimum(short, slope, jnp.asarray(p / size), r.size))


def _linearised(how: Method | Growing, problem: Problem, z) -> tuple[Array, Array]:
    if not how.least_squares:
        return linearise(problem, z)[:2]
    return iterate(how, problem, how.begin(z, stages=False), 1, 1).linearised
