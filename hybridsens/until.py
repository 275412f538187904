"""Where a motion ends before t1: with the first event that its caller chooses."""

from collections.abc import Callable
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jax import lax

from .validation.asked import Asked
from .validation.lost_derivatives import hides_tracers
from .validation.program import digest, traced
from .validation.same_function import same_function


def checked_until(
    until: Callable[..., Any] | None, owner: Any, blank_event: Callable[[], Any]
) -> tuple[Callable[..., Any] | None, str]:
    """`until`, a function of a scene or a system and one event, and what names its program.

    Raises: TypeError where it returns anything but one boolean, or closes over a traced value."""
    if until is None:
        return None, ""
    until, event = same_function(until), blank_event()
    asked = Asked("until(scene, event)" if hasattr(event, "kind") else "until(system, event)", until)
    trace = traced(lambda owner, event: _boolean(asked, owner, event), (owner, event))
    if hides_tracers(trace):
        raise TypeError(
            "`until` must be made of what it is given, but closes over a value that JAX traces: make it a field of the "
            f"{type(owner).__name__}."
        )
    return until, digest([trace])


def _boolean(asked: Asked, owner: Any, event: Any) -> jax.Array:
    try:
        found = asked(owner, event)
    except jax.errors.TracerBoolConversionError as error:
        raise TypeError(
            f"`{asked.name}` must be a function that JAX can trace: write `&` and `|` in place of `and` and `or`, and "
            "jnp.where in place of `if`."
        ) from error
    if isinstance(found, bool):
        return jnp.asarray(found)
    if not isinstance(found, np.bool_ | np.ndarray | jax.Array):
        raise TypeError(f"`{asked.name}` must return one boolean, but returns {type(found).__name__}.")
    if found.shape != () or not jnp.issubdtype(found.dtype, jnp.bool_):
        raise TypeError(f"`{asked.name}` must return one boolean, but returns {found.dtype} of shape {found.shape}.")
    return jnp.asarray(found)


def ends_with(until: Callable[..., Any] | None, owner: Any, event: Callable[[], Any]) -> jax.Array | bool:
    """Whether a motion ends with an event: never where there is no `until`. It is not differentiated."""
    return False if until is None else lax.stop_gradient(jnp.asarray(until(owner, event())))
