"""The gradient at the tolerance that motions have by default; a check is made at a far tighter one."""

from typing import Any, NamedTuple

import jax.numpy as jnp
import numpy as np

from ..adjoint.methods import AbstractGradientMethod
from ..export.text import wrapped
from ..parameters import FlatParameters
from ..settings import finest_tolerance
from .differentiate import QUICKLY
from .functional import Cost, all_reached_end
from .gradient_methods import gradient_by

DEFAULT = 1e-8
"""rtol = atol of `simulate` and `solve`."""
FAR = 1e-3
"""A larger deviation has a remedy told."""


class AtDefault(NamedTuple):
    """By how much the gradient at the default tolerance is another one, where a small error of the motion grows, as by
    impacts that almost graze."""

    parameter: str
    """That whose derivative is off the most."""
    deviation: float
    """Relative, as deviations of a check are; nan where that motion is not successful."""

    def __str__(self) -> str:
        begin = f"At the default tolerance of a motion, rtol = atol = {DEFAULT:.0e},"
        if np.isnan(self.deviation):
            return wrapped(f"{begin} it is not successful: tighten rtol and atol where you use it.", 4)
        if self.deviation <= FAR:
            return wrapped(f"{begin} the gradient is this one to {self.deviation:.1e}.", 4)
        off = f"the derivative by {self.parameter} is off by {self.deviation:.1e} of its size"
        return wrapped(f"{begin} {off}: tighten rtol and atol where you use it.", 4)


def at_default(
    parameters: FlatParameters, cost: Cost, method: AbstractGradientMethod, settings: dict[str, Any], known, size
) -> AtDefault | None:
    """What is off the gradient that is known, by what deviations are measured by; None where no tighter tolerance was
    met."""
    finest = finest_tolerance(jnp.result_type(parameters.vector))
    if not max(settings["rtol"], settings["atol"], finest) < DEFAULT:
        return None
    _, gradient, reported = gradient_by(method, parameters, cost, settings | dict(rtol=DEFAULT, atol=DEFAULT), QUICKLY)
    off = np.abs(np.asarray(gradient) - known) / np.where(size > 0, size, 1)
    worst = int(np.argmax(off))  # a nan before all others
    return AtDefault(parameters.names[worst], float(off[worst]) if all_reached_end(reported) else np.nan)
