"""Traced values that a function closes over: a custom derivative rule would not see them."""

from collections.abc import Callable

import equinox as eqx
import jax
import jax.core


def method_of(name: str) -> Callable:
    """A method as a function that closes over something: Equinox leaves others as they are."""
    return lambda scene, *given: getattr(scene, name)(*given)


def hides_tracers(function: Callable, arguments) -> bool:
    """Whether tracing the function meets a traced value that is neither an argument nor a leaf of the function."""
    dynamic, static = eqx.partition((function, arguments), eqx.is_array)

    def call(dynamic):
        function, arguments = eqx.combine(dynamic, static)
        return eqx.filter(function(*arguments), eqx.is_array)

    constants = jax.make_jaxpr(call)(
        jax.tree.map(lambda leaf: jax.ShapeDtypeStruct(leaf.shape, leaf.dtype), dynamic)
    ).consts
    return any(isinstance(constant, jax.core.Tracer) for constant in constants)
