"""Derivatives that would be lost: by traced values that a function closes over, which a custom derivative rule does not
see, and through the mode, which is not differentiated."""

import functools
from collections.abc import Callable
from typing import Any

import equinox as eqx
import jax
import jax.core
import jax.numpy as jnp
from jax.custom_derivatives import SymbolicZero
from jax.extend.core import ClosedJaxpr

from .caller import warn_caller


def method_of(name: str) -> Callable:
    """A method as a function that closes over something: Equinox leaves others as they are."""
    return lambda scene, *given: getattr(scene, name)(*given)


def hides_tracers(trace: ClosedJaxpr) -> bool:
    """Whether what was traced met a traced value that is neither an argument nor a leaf of the function."""
    return any(isinstance(constant, jax.core.Tracer) for constant in trace.consts)


STOP = "Where no derivative is meant, write jax.lax.stop_gradient around it."


def warn_of_mode_after(function: Callable, owner: Any, given: tuple, title: str, remedy: str) -> None:
    """Say where `function(owner, event, t, *state, mode)`, which returns (state after, mode after), writes a number
    into the mode that depends on t, on the state or on a parameter: what is made from it has no derivative by them.

    A mode without real numbers costs nothing. What comes from a comparison, a rounding or `jax.lax.stop_gradient` has
    no derivative to lose."""
    event, *moving, mode = given
    if not any(map(eqx.is_inexact_array, jax.tree.leaves(mode))):
        return
    parameters, rest = eqx.partition(owner, eqx.is_inexact_array)
    names: list[str] = []

    def mode_after(parameters, moving):
        return _leaf_by_leaf(names.append, function(eqx.combine(parameters, rest), event, *moving, mode)[1])

    jax.eval_shape(lambda *given: jax.jvp(mode_after, given, given), parameters, moving)
    if names:
        warn_caller(
            f"The mode is not differentiated, but {title} writes into {', '.join(sorted(names))} what depends on t, on "
            f"the state or on a parameter: derivatives miss that. {remedy} {STOP}"
        )


def undifferentiated(mode: Any) -> Any:
    """An initial mode, held constant; a warning names its real numbers that a derivative is taken by."""
    warn = lambda name: warn_caller(
        f"The mode is not differentiated, but a derivative is taken by what {name} is made from: it misses that. Make "
        f"it a field of the system or a part of the state. {STOP}"
    )
    return jax.lax.stop_gradient(_leaf_by_leaf(warn, mode))


def _leaf_by_leaf(tell: Callable[[str], None], mode: Any) -> Any:
    """The mode, of which `tell` is told the names of the leaves that are differentiated, once they are."""

    def told(path, leaf):
        leaf = jnp.asarray(leaf)
        return _told(lambda: tell(f"mode{jax.tree_util.keystr(path)}"), leaf) if eqx.is_inexact_array(leaf) else leaf

    return jax.tree_util.tree_map_with_path(told, mode)


@functools.partial(jax.custom_jvp, nondiff_argnums=(0,))
def _told(tell: Callable[[], None], leaf):
    del tell
    return leaf


def _told_jvp(tell: Callable[[], None], primals, tangents):
    if not isinstance(tangents[0], SymbolicZero):
        tell()
    return primals[0], jnp.zeros_like(primals[0])


_told.defjvp(_told_jvp, symbolic_zeros=True)
