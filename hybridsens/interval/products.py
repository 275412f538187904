"""Products of jets, computed once where a function has many.

Each bound of a product is made of several bounds of its factors. Of a long function a compiler makes, for each bound at
its end, one program of all products that lead to it: thousands of operations, most of them the same ones.
"""

from collections.abc import Callable
from typing import Any

from .arithmetic import Interval
from .calls import CALLS, inner_jaxpr
from .jet import Jet

PRODUCTS = {"mul", "dot_general"}
"""Primitives."""
FEW = 12
"""So many products are computed in one piece, which takes less time to run."""

Once = Callable[[Callable[[], Any]], Any]
"""once(function): its result, as `xla.once` has it computed."""


def at_once(function: Callable[[], Any]) -> Any:
    """The result of a function, in one piece with what is around it."""
    return function()


def count_products(jaxpr) -> int:
    """How many products there are in a program and in those that it calls."""
    names = [equation.primitive.name for equation in jaxpr.eqns]
    calls = (equation for equation, name in zip(jaxpr.eqns, names, strict=True) if name in CALLS)
    return sum(name in PRODUCTS for name in names) + sum(count_products(inner_jaxpr(call)[0]) for call in calls)


def product_once(product: Callable[[], Any], once: Once) -> Jet:
    """A product, computed once. Exact numbers in it stay exact."""
    exact: list[bool | None] = []

    def bounds():
        jet = product()
        exact.extend(None if part is None else part.exact for part in jet)
        return [(part.low,) if part.exact else tuple(part) for part in jet if part is not None]

    found = iter(once(bounds))
    parts: list[Any] = [None if is_exact is None else _interval(*next(found)) for is_exact in exact]
    return Jet(*parts)


def _interval(low, high=None) -> Interval:
    return Interval(low, low if high is None else high)
