"""What functions compute, told apart: a number that a method reads from a global may have changed since the last call.

JAX keeps a compiled program by what it is given, and a global is not given. So the functions of a scene or a system,
which every call traces anew, name the program that is made of them: another trace is another program."""

import enum
import hashlib
from collections.abc import Callable, Iterable
from typing import Any

import equinox as eqx
import jax
import jax.core
import jax.numpy as jnp
import numpy as np
from jax.extend.core import ClosedJaxpr, Jaxpr, Literal


def traced(function: Callable, arguments) -> ClosedJaxpr:
    """What a function does with arguments of these types."""
    dynamic, static = eqx.partition((function, arguments), eqx.is_array)

    def call(dynamic):
        function, arguments = eqx.combine(dynamic, static)
        return eqx.filter(function(*arguments), eqx.is_array)

    return jax.make_jaxpr(call)(jax.tree.map(lambda leaf: jax.ShapeDtypeStruct(leaf.shape, leaf.dtype), dynamic))


def digest(traces: Iterable[ClosedJaxpr]) -> str:
    """The same for the same programs: equations, numbers and arrays in them, but no functions, which are made anew."""
    told = hashlib.blake2b(digest_size=16)
    for trace in traces:
        _tell(told.update, trace)
    return told.hexdigest()


def array_bytes(array: Any) -> bytes:
    """Type, shape and numbers of an array, those of a random key too."""
    is_key = jnp.issubdtype(array.dtype, jax.dtypes.prng_key)
    values = np.asarray(jax.random.key_data(array) if is_key else array)
    return f"{values.dtype} {values.shape} ".encode() + values.tobytes()


def _tell(tell: Callable[[bytes], Any], part: Any) -> None:
    if isinstance(part, ClosedJaxpr):
        _tell_equations(tell, part.jaxpr)
        _tell(tell, part.consts)
    elif isinstance(part, Jaxpr):
        _tell_equations(tell, part)
    elif isinstance(part, tuple | list):
        tell(b"(")
        for inner in part:
            _tell(tell, inner)
    elif isinstance(part, jax.core.Tracer):
        tell(str(part.aval).encode())
    elif isinstance(part, np.ndarray | np.generic | jax.Array):
        tell(array_bytes(part))
    elif part is None or isinstance(part, bool | int | float | complex | str | enum.Enum | np.dtype):
        tell(repr(part).encode())
    elif isinstance(part, dict):
        _tell(tell, list(part.items()))
    else:
        tell(type(part).__name__.encode())


def _tell_equations(tell: Callable[[bytes], Any], jaxpr: Jaxpr) -> None:
    places = {var: place for place, var in enumerate([*jaxpr.constvars, *jaxpr.invars])}
    place = lambda operand: operand.val if isinstance(operand, Literal) else f"v{places[operand]}"
    for equation in jaxpr.eqns:
        _tell(tell, [equation.primitive.name, *map(place, equation.invars), *equation.params.values()])
        places |= {var: len(places) + number for number, var in enumerate(equation.outvars)}
    _tell(tell, [place(var) for var in jaxpr.outvars])
