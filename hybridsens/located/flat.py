"""A trace whose equations compare, or are smooth: what compares inside of calls, or in other words, is said plainly."""

from collections.abc import Callable
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
from jax import lax
from jax.extend.core import Jaxpr, JaxprEqn, Literal

from ..interval.break_rules import KEEP_ENTRIES, is_square
from ..interval.repeats import Distinct, identity, needed_for
from .made_of import compares_inside, is_call, made_of
from .rules import is_real

CHOICES: dict[str, Callable] = {"max": jnp.maximum, "min": jnp.minimum, "clamp": lax.clamp, "abs": jnp.abs}
"""Operations whose result is one of their operands, or its opposite."""

MOST_CHOICES = 8
"""An equality of more operands than that is left as it is."""


class Choice(NamedTuple):
    """A number that is one of others."""

    name: str
    of: tuple[Any, ...]


class Flat(Distinct):
    """The equations of a trace, and of those calls that compare inside, each once, with floors for what steps."""

    def __init__(self):
        super().__init__()
        self._shifts: set[Any] = set()
        """Results of largest numbers by which only an exponent is shifted."""
        self._by: dict[Any, JaxprEqn] = {}
        """The equation of each result."""

    def _run(self, jaxpr: Jaxpr, given: list[Any]) -> list[Any]:
        # In softmax and logsumexp: what is shifted by a number without a derivative is smooth as a whole.
        _, needed = needed_for([e for e in jaxpr.eqns if e.primitive.name != "stop_gradient"], jaxpr.outvars)
        largest = (e.outvars[0] for e in jaxpr.eqns if e.primitive.name == "reduce_max")
        self._shifts.update(result for result in largest if result not in needed)
        return super()._run(jaxpr, given)

    def goes_inside(self, equation: JaxprEqn) -> bool:
        if self._shifts.intersection(equation.outvars):
            return False
        return made_of(equation) is not None or (is_call(equation) and compares_inside(equation))

    def _call(self, equation: JaxprEqn, operands: list[Any]) -> list[Any]:
        """As of the program that it calls, or of the one that it is made of."""
        function = made_of(equation)
        return super()._call(equation, operands) if function is None else self._traced(function, operands)

    def _traced(self, function: Callable, operands: list[Any]) -> list[Any]:
        """Results of a function of these operands."""
        program = jax.make_jaxpr(function)(*(operand.aval for operand in operands))
        return self._run(program.jaxpr, [*self._constants(program), *operands])

    def _once(self, equation: JaxprEqn, operands: list[Any]) -> list[Any]:
        """As it is, unless what its operands were made by says it in a way that stays exact at the surface."""
        given, result = equation.replace(invars=operands), equation.outvars[0].aval
        ways = {"sqrt": self._root, "div": self._quotient, "eq": self._equality, "ne": self._equality}
        way = ways.get(equation.primitive.name)
        instead = None if way is None else way(given, result)
        if instead is not None:
            return self._traced(*instead)
        results = super()._once(equation, operands)
        self._by.update(dict.fromkeys(results[:1], given))
        return results

    def _root(self, equation: JaxprEqn, result: Any) -> tuple[Callable, list[Any]] | None:
        """The root of a square is |x|."""
        square = self._maker(equation.invars[0])
        if square is None or not is_square(square):
            return None
        return lambda x: jnp.abs(x).reshape(result.shape), [square.invars[0]]

    def _quotient(self, equation: JaxprEqn, result: Any) -> tuple[Callable, list[Any]] | None:
        """c x / |x| is c sign(x): next to the surface the quotient has no digit left in its derivative."""
        below = self._maker(equation.invars[1])
        if below is None or below.primitive.name != "abs":
            return None
        x = below.invars[0]
        factors = self._factors(equation.invars[0], self._source(x))
        if factors is None or any(_size(factor) not in (1, result.size) for factor in (x, *factors)):
            return None
        shaped = lambda x: x.reshape(result.shape if x.size == result.size else ())

        def quotient(x, *factors):
            product = jnp.sign(shaped(x))
            for factor in factors:
                product = product * shaped(factor)
            return jnp.broadcast_to(product, result.shape)

        return quotient, [x, *factors]

    def _factors(self, product: Any, x: Any) -> list[Any] | None:
        """What x is multiplied by in a product; None where it is no factor of it."""
        if self._source(product) is x:
            return []
        maker = self._maker(product)
        if maker is None or maker.primitive.name != "mul":
            return None
        for one, other in (maker.invars, maker.invars[::-1]):
            factors = self._factors(one, x)
            if factors is not None:
                return [*factors, other]
        return None

    def _equality(self, equation: JaxprEqn, result: Any) -> tuple[Callable, list[Any]] | None:
        """Of choices: in each case of what is chosen, where a number is that number itself."""
        if equation.invars[0] is equation.invars[1]:  # asks for nan
            return None
        one, other = map(self._choice, equation.invars)
        if not isinstance(one, Choice) and not isinstance(other, Choice) or not is_real(equation):
            return None
        leaves = {identity(leaf): leaf for side in (one, other) for leaf in _leaves(side)}
        if len(leaves) > MOST_CHOICES:
            return None

        def asked(*values):
            known = dict(zip(leaves, values, strict=True))
            equal = jnp.broadcast_to(_equal(one, other, known), result.shape)
            return equal if equation.primitive.name == "eq" else ~equal

        return asked, list(leaves.values())

    def _choice(self, atom: Any) -> Any:
        """A number as a choice of others, if it is one."""
        maker = None if isinstance(atom, Literal) else self._by.get(atom)
        if maker is None or maker.primitive.name not in CHOICES:
            return atom
        return Choice(maker.primitive.name, tuple(map(self._choice, maker.invars)))

    def _maker(self, atom: Any) -> JaxprEqn | None:
        """The equation that made a number, whatever its shape."""
        source = self._source(atom)
        return None if isinstance(source, Literal) else self._by.get(source)

    def _source(self, atom: Any) -> Any:
        """The same entries before they were moved to another shape."""
        maker = None if isinstance(atom, Literal) else self._by.get(atom)
        if maker is None or maker.primitive.name not in KEEP_ENTRIES or _size(maker.invars[0]) != _size(atom):
            return atom
        return self._source(maker.invars[0])


def _size(atom: Any) -> int:
    return atom.aval.size


def _leaves(side: Any) -> list[Any]:
    """The numbers of which one is chosen."""
    return [leaf for part in side.of for leaf in _leaves(part)] if isinstance(side, Choice) else [side]


def _value(side: Any, known: dict[Any, Any]):
    if isinstance(side, Choice):
        return CHOICES[side.name](*(_value(part, known) for part in side.of))
    return known[identity(side)]


def _equal(one: Any, other: Any, known: dict[Any, Any]):
    """Whether two numbers are equal, each a number or a choice of others."""
    if isinstance(one, Choice):
        return _in_each_case(one, other, known)
    if isinstance(other, Choice):
        return _equal(other, one, known)
    if identity(one) == identity(other):
        return jnp.array(True)
    a, b = known[identity(one)], known[identity(other)]
    return (a >= b) & (a <= b)


def _in_each_case(choice: Choice, other: Any, known: dict[Any, Any]):
    parts = [(_value(part, known), _equal(part, other, known)) for part in choice.of]
    if choice.name == "abs":
        (x, equal), y = parts[0], _value(other, known)
        return jnp.where(x >= 0, equal, (-x >= y) & (-x <= y))
    if choice.name == "clamp":
        (low, is_low), (x, is_x), (high, is_high) = parts
        return jnp.where(x >= low, jnp.where(high >= x, is_x, is_high), is_low)
    (a, is_a), (b, is_b) = parts
    return jnp.where(a >= b, is_a, is_b) if choice.name == "max" else jnp.where(a >= b, is_b, is_a)
