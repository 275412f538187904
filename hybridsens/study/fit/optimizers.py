"""The choices for `optimizer=`: by name, an Optimistix Gauss-Newton solver, or any Optax optimizer."""

import functools
from typing import Any

import equinox as eqx
import optax
import optimistix

from . import gradient_descent, least_squares
from .outcome import Outcome


class Method(eqx.Module):
    """An optimizer with its settings, ready to be compiled."""

    optimizer: Any

    @property
    def _steps(self) -> Any:
        return least_squares if isinstance(self.optimizer, optimistix.AbstractGaussNewton) else gradient_descent

    def start(self, problem, z) -> tuple[Any, Outcome]:
        """Value and derivative at z, and the optimizer's first state."""
        return self._steps.start(self.optimizer, problem, z)

    def step(self, problem, carry) -> tuple[Any, Outcome]:
        """One iteration, compiled once for all problems of one structure."""
        return self._steps.step(self.optimizer, problem, carry)


@functools.cache
def _by_name(name: str) -> Any:
    """Cached, so that a second fit finds its compiled steps again."""
    if name == "levenberg-marquardt":
        return least_squares.LevenbergMarquardt()
    if name == "gauss-newton":
        return least_squares.GaussNewton()
    return {"adam": lambda: optax.adam(0.02), "lbfgs": optax.lbfgs}[name]()


NAMES = ("levenberg-marquardt", "gauss-newton", "lbfgs", "adam")


def method(optimizer: Any) -> Method:
    """The method that a user means.

    Raises: ValueError for an unknown name, TypeError for anything that is neither a Gauss-Newton solver of Optimistix
    nor an Optax optimizer.
    """
    if isinstance(optimizer, str):
        if optimizer not in NAMES:
            raise ValueError(f"`optimizer` must be one of {NAMES}, but is {optimizer!r}.")
        optimizer = _by_name(optimizer)
    if isinstance(optimizer, optimistix.AbstractGaussNewton | optax.GradientTransformation):
        return Method(optimizer)
    raise TypeError(
        f"`optimizer` must be one of {NAMES}, an Optimistix Gauss-Newton solver or an Optax optimizer, but is "
        f"{type(optimizer).__name__}."
    )
