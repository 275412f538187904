"""Interval arithmetic on arrays: the range of an operation over every choice of its operands.

The idea is Moore's (Interval Analysis, 1966): operate on bounds, round outward, and the result holds whatever the true
value is. A bound that is no number says that nothing is known; it spreads through every operation and compares as
false, so it can never prove anything. `None` is an exact zero, which costs nothing.
"""

from typing import Any, NamedTuple

import jax.numpy as jnp
from jaxtyping import Array

ROUNDING = 4
"""How many units in the last place a result is moved outward."""


class Interval(NamedTuple):
    """All values from `low` to `high`, entry by entry. One array in both places is an exact number."""

    low: Array
    high: Array

    @property
    def exact(self) -> bool:
        return self.low is self.high


def point(x) -> Interval:
    """An exact number as an interval."""
    return Interval(x, x)


def each(operation, a: Interval) -> Interval:
    """An operation that keeps order and does not round, on both bounds."""
    low = operation(a.low)
    return Interval(low, low if a.exact else operation(a.high))


def outward(low, high) -> Interval:
    """Bounds moved outward by what computing them may have rounded."""
    eps = ROUNDING * jnp.finfo(low.dtype).eps
    return Interval(low * jnp.where(low < 0, 1 + eps, 1 - eps), high * jnp.where(high < 0, 1 - eps, 1 + eps))


def increasing(f, a: Interval) -> Interval:
    """Range of an increasing function."""
    return outward(f(a.low), f(a.high))


def hull(a: Interval, b: Interval) -> Interval:
    """The smallest interval that holds both."""
    return Interval(jnp.minimum(a.low, b.low), jnp.maximum(a.high, b.high))


def negative(a: Interval | None) -> Any:  # an interval; None only if the operands make an exact zero
    """-a"""
    if a is None:
        return None
    low = -a.high
    return Interval(low, low if a.exact else -a.low)


def plus(*terms: Interval | None) -> Any:  # an interval; None only if the operands make an exact zero
    """Sum of intervals."""
    there = [term for term in terms if term is not None]
    if len(there) < 2:
        return there[0] if there else None
    low, high = there[0]
    for term in there[1:]:
        low, high = low + term.low, high + term.high
    return outward(low, high)


def times(a: Interval | None, b: Interval | None) -> Any:  # an interval; None only if the operands make an exact zero
    """Product of two intervals; of one with itself it is `square`."""
    if a is None or b is None:
        return None
    if a is b:
        return square(a)
    if a.exact:
        a, b = b, a
    products = [a.low * b.low, a.high * b.low]
    if not b.exact:
        products += [a.low * b.high, a.high * b.high]
    low, high = products[0], products[0]
    for product in products[1:]:
        low, high = jnp.minimum(low, product), jnp.maximum(high, product)
    return outward(low, high)


def scaled(a: Interval | None, factor: float) -> Any:  # an interval; None only if the operands make an exact zero
    """A number times an interval."""
    if a is None or factor == 1:
        return a
    low, high = (a.low, a.high) if factor > 0 else (a.high, a.low)
    return outward(factor * low, factor * high)


def power(a: Interval, n: int) -> Interval:
    """a^n for an integer n."""
    if n < 0:
        return reciprocal(power(a, -n))
    if n == 0:
        return point(jnp.ones_like(a.low))
    if n == 1:
        return a
    low, high = a.low**n, a.high**n
    if n % 2 == 0:
        straddles = (a.low < 0) & (a.high > 0)
        low, high = jnp.where(straddles, 0, jnp.minimum(low, high)), jnp.maximum(low, high)
    return outward(low, high)


def power_of(a: Interval, p) -> Interval:
    """a^p for numbers p that are known when the motion runs; where p is no integer, unknown for a below 0."""
    integer, odd = p == jnp.round(p), jnp.mod(p, 2) == 1
    straddles = (a.low <= 0) & (a.high >= 0)
    nearest = jnp.where(straddles, 0, jnp.minimum(jnp.abs(a.low), jnp.abs(a.high)))
    sizes = nearest**p, jnp.maximum(jnp.abs(a.low), jnp.abs(a.high)) ** p
    of_size = jnp.minimum(*sizes), jnp.maximum(*sizes)
    ends = jnp.sign(a.low) * jnp.abs(a.low) ** p, jnp.sign(a.high) * jnp.abs(a.high) ** p
    low, high = (jnp.where(odd, f(*ends), g) for f, g in zip((jnp.minimum, jnp.maximum), of_size, strict=True))
    known = (integer | (a.low >= 0)) & ~(straddles & (p < 0))
    return outward(jnp.where(known, low, jnp.nan), jnp.where(known, high, jnp.nan))


def square(a: Interval) -> Interval:
    """a^2, never negative."""
    return power(a, 2)


def reciprocal(a: Interval) -> Interval:
    """1 / a; unknown where a holds zero."""
    divides = (a.low > 0) | (a.high < 0)
    return outward(jnp.where(divides, 1 / a.high, jnp.nan), jnp.where(divides, 1 / a.low, jnp.nan))


def wave(f, a: Interval, peak: float) -> Interval:
    """Range of a sine or cosine whose maxima lie at `peak` and every 2 pi beside it."""
    low, high = jnp.minimum(f(a.low), f(a.high)), jnp.maximum(f(a.low), f(a.high))
    low, high = outward(low, high)
    holds = lambda place: place + jnp.ceil((a.low - place) / (2 * jnp.pi)) * 2 * jnp.pi <= a.high
    return Interval(jnp.where(holds(peak - jnp.pi), -1, low), jnp.where(holds(peak), 1, high))
