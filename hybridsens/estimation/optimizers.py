"""The choices for `optimizer=`: by name, an Optimistix Gauss-Newton solver, or any Optax optimizer."""

import functools
from typing import Any

import equinox as eqx
import jax.numpy as jnp
import optax
import optimistix
from jaxtyping import Array

from ..validation.spelling import did_you_mean
from . import gradient_descent, least_squares
from .least_squares import FAR
from .problem import Outcome


class Method(eqx.Module):
    """An optimizer with its settings, ready to be compiled."""

    optimizer: Any

    @property
    def least_squares(self) -> bool:
        """Whether it uses residuals and their Jacobian; otherwise the gradient of the loss."""
        return isinstance(self.optimizer, optimistix.AbstractGaussNewton)

    def begin(self, z, damping: float | Array = FAR, stages: bool = True) -> Any:
        """The state of an optimizer that has evaluated nothing yet; `damping` serves Levenberg-Marquardt alone,
        `stages` those optimizers that have any."""
        del stages
        if self.least_squares:
            return least_squares.begin(self.optimizer, z, jnp.asarray(damping))
        return gradient_descent.begin(self.optimizer, z)

    def step(self, problem, carry) -> tuple[Any, Outcome, Any]:
        """Evaluate the next trial point, the first time the point of `begin`: the new state, what happened, and
        residuals with their Jacobian there, if the optimizer uses them (else None)."""
        steps = least_squares if self.least_squares else gradient_descent
        return steps.step(self.optimizer, problem, carry)

    def confirms(self, problem, z) -> bool:
        """Whether z, to which small steps led, is a minimum. Those of Gauss-Newton solvers are small for that alone;
        those of Optax are also as small as a schedule, or the unit of the loss, has made them."""
        return self.least_squares or least_squares.is_near_minimum(problem, z)


_MADE_BY = {
    "levenberg-marquardt": least_squares.LevenbergMarquardt,
    "gauss-newton": least_squares.GaussNewton,
    "lbfgs": optax.lbfgs,
    "adam": lambda: optax.adam(0.02),
}
NAMES = tuple(_MADE_BY)


@functools.cache
def _by_name(name: str) -> Any:
    """Cached, so that a second fit finds its compiled steps again."""
    return _MADE_BY[name]()


def chosen_method(optimizer: Any) -> Method:
    """The method that a user means.

    Raises: ValueError for an unknown name, TypeError for anything that is neither a Gauss-Newton solver of Optimistix
    nor an Optax optimizer.
    """
    if isinstance(optimizer, str):
        if optimizer not in NAMES:
            raise ValueError(
                f"`optimizer` must be one of {NAMES}, but is {optimizer!r}.{did_you_mean(optimizer, NAMES)}"
            )
        optimizer = _by_name(optimizer)
    if isinstance(optimizer, optimistix.AbstractGaussNewton | optax.GradientTransformation):
        return Method(optimizer)
    raise TypeError(
        f"`optimizer` must be one of {NAMES}, an Optimistix Gauss-Newton solver or an Optax optimizer, but is "
        f"{type(optimizer).__name__}."
    )
