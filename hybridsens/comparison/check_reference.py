"""Gradients whose derivatives are surely resolved: what a gradient in doubt is held against."""

from typing import Any

import diffrax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Float

from ..adjoint.methods import Replay
from ..parameters import FlatParameters
from .differentiate import QUICKLY, value_and_gradient
from .functional import Cost, all_reached_end, functional
from .gradient_methods import from_adjoint

TIGHTER = 1e-3
"""How much better than by default a step must resolve the derivative here."""
FINEST = 4096
"""Roundings: no step is asked to be better than this many."""


def tight_replay(rtol: float, dtype) -> Replay:
    """A replay with `TIGHTER` error control of the derivative; `rtol` is that of the motion."""
    default = min(100 * rtol, max(1e-5, rtol))
    return Replay(rtol=max(TIGHTER * default, FINEST * float(jnp.finfo(dtype).eps)))


def resolved_gradient(parameters: FlatParameters, cost: Cost, settings: dict[str, Any], counts: list[int]):
    """The gradient on the motion that is given, with its derivative resolved to `tight_replay`.

    nan where the steps do not suffice for that, or where the motions do not have the given numbers of events.
    """
    method = from_adjoint(tight_replay(settings["rtol"], parameters.vector.dtype), **settings)
    run = value_and_gradient(functional(parameters, cost, method.simulate), method.mode, options=QUICKLY)
    _, gradient, reported = run(parameters.vector)
    same = all_reached_end(reported) and [int(count) for count in reported.count] == counts
    return np.asarray(gradient) if same else np.full(parameters.vector.shape, np.nan)


def reference_gradient(
    parameters: FlatParameters, cost: Cost, settings: dict[str, Any], counts: list[int]
) -> Float[np.ndarray, "parameter"]:
    """The same on a motion by another solver, of order 8, with tolerances ten times tighter.

    It shares neither the steps nor the error estimate of the gradient that is checked.
    """
    finest = 256 * float(jnp.finfo(parameters.vector.dtype).eps)
    rtol, atol = (min(settings[name], max(0.1 * settings[name], finest)) for name in ("rtol", "atol"))
    tighter = settings | dict(solver=diffrax.Dopri8(), rtol=rtol, atol=atol)
    return resolved_gradient(parameters, cost, tighter, counts)
