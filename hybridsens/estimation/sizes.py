"""How large a parameter is whose guess is 0, or next to it: what it does to the residuals tells, and no unit."""

import dataclasses

import jax.numpy as jnp
import numpy as np
from jaxtyping import Float

from .data import Measurements
from .growing import Growing
from .iterate import iterate
from .optimizers import Method
from .problem import FitProblem

EXACT = 1e-7
"""Residuals of so small a part of the data's range are errors of the computation (its tolerance is 1e-8), no noise."""
_BEGIN = 0.1
"""Where a guess of 0 on its bound begins, as a part of the size that is found: on the bound nothing leads away."""
_LEAST = 1e-9
"""What such a parameter counts in until then: the motion is to be that at 0, in any unit."""
_TINY = 1e-6
"""A guess that does less to the residuals, as a part of them, is as good as 0. Larger numbers are not asked."""


def largest_datum(data: Measurements) -> float:
    """In sigmas, to measure by what is rounding."""
    sigmas = 1.0 if data.sigmas is None else data.sigmas
    parts = (np.ravel(data.values / sigmas), data.event_times / data.event_sigmas)
    return float(np.nanmax(np.abs(np.concatenate(parts))))


def with_sizes(method: Method | Growing, problem: FitProblem, data: Measurements) -> FitProblem:
    """The problem, with the sizes of those parameters whose guess is 0, or does next to nothing, but for those with two
    bounds, which tell a size: from 1e-12 an optimizer that counts in guesses would not come to 0.1.

    1 of their unknown moves the residuals by as much as these are at the guess, where the most effective entry of an
    array speaks for all of it. An optimizer that uses no Jacobian is not given one for this, and none is known where
    the motion fails; there the size stays 1, as it does where there is nothing left to move.
    """
    selection = problem.selection
    guess = np.asarray(selection.values(problem.scene))
    below, above = np.isfinite(selection.lower), np.isfinite(selection.upper)
    one_sided, bound = below ^ above, np.where(below, selection.lower, selection.upper)
    on_bound = one_sided & (guess == 0) & (bound == 0)
    zero = on_bound | ((guess == 0) & ~below & ~above)
    small = ~zero & (np.abs(guess) < _TINY) & ~(below & above)
    if not (zero | small).any() or not method.least_squares:
        return problem
    at_bound = dataclasses.replace(selection, scale=np.where(on_bound, _LEAST, selection.scale))
    begin, there = at_bound.from_values(guess), dataclasses.replace(problem, selection=at_bound)
    done = iterate(method, there, method.begin(begin, stages=False), 1, 1)
    r, jacobian = (np.asarray(part) for part in done.linearised)
    if done.outcomes[0].trial.failed or not np.linalg.norm(r) > EXACT * largest_datum(data):
        return problem
    moved, size = np.linalg.norm(jacobian, axis=0), np.linalg.norm(r)
    unknown = zero | (small & (moved < _TINY * size))
    per_unit = np.where(one_sided, np.abs(at_bound.to_values(begin) - bound), selection.scale)  # |dp/dz|
    effect = _of_arrays(problem, np.where(unknown, moved / per_unit, 0))
    known = unknown & (effect > 0)
    scale = np.where(known, size / np.where(known, effect, 1), selection.scale)
    inside = bound + _BEGIN * np.where(below, scale, -scale)
    scene = selection.insert(problem.scene, jnp.asarray(np.where(known & on_bound, inside, guess)))
    return dataclasses.replace(problem, scene=scene, selection=dataclasses.replace(selection, scale=scale))


def _of_arrays(problem: FitProblem, effect) -> Float[np.ndarray, "parameter"]:
    """The largest of each array, in the place of all its entries."""
    sizes = [part.size for part in problem.selection.parts]
    parts = np.split(effect, np.cumsum(sizes)[:-1])
    return np.concatenate([np.full(part.size, np.max(part, initial=0)) for part in parts])
