"""Ranges of a function of one variable and of its first two derivatives, carried through each operation together.

A jet encloses f, f' and f'' over an interval of s. With f and f' known at one end, f'' bounds f to third order in the
length of the interval: that is what makes a short walk of a search that f alone would send over every small stretch.
"""

from typing import Any, NamedTuple

import jax.numpy as jnp
from jax import lax

from .arithmetic import (
    Interval,
    each,
    hull,
    increasing,
    negative,
    plus,
    point,
    power,
    power_of,
    reciprocal,
    scaled,
    square,
    times,
    wave,
)


class Jet(NamedTuple):
    """Ranges of f, f' and f'' over an interval; `None` is an exact zero."""

    value: Interval
    rate: Interval | None
    bend: Interval | None


class Truth(NamedTuple):
    """Whether a condition holds somewhere over an interval (`possible`), and whether everywhere (`sure`)."""

    sure: jnp.ndarray
    possible: jnp.ndarray


def linear(operation, jet: Jet) -> Jet:
    """A linear operation without negative weights: a reshape, a slice, a sum."""
    parts: list[Any] = [None if part is None else each(operation, part) for part in jet]
    return Jet(*parts)


def add(a: Jet, b: Jet) -> Jet:
    return Jet(*(plus(x, y) for x, y in zip(a, b, strict=True)))


def negate(a: Jet) -> Jet:
    return Jet(*(negative(x) for x in a))


def subtract(a: Jet, b: Jet) -> Jet:
    return add(a, negate(b))


def bilinear(product, a: Jet, b: Jet) -> Jet:
    """A product of any kind, by its rule (a b)'' = a'' b + 2 a' b' + a b''."""
    rate = plus(product(a.rate, b.value), product(a.value, b.rate))
    bend = plus(product(a.bend, b.value), scaled(product(a.rate, b.rate), 2.0), product(a.value, b.bend))
    return Jet(product(a.value, b.value), rate, bend)


def multiply(a: Jet, b: Jet) -> Jet:
    return integer_power(a, 2) if a is b else bilinear(times, a, b)


def composed(a: Jet, value: Interval, slope: Interval | None, curve: Interval | None) -> Jet:
    """f(a) from the ranges of f, f' and f'' over a: f' a' and f'' a'^2 + f' a''."""
    rate = times(slope, a.rate)
    squared = None if a.rate is None else square(a.rate)
    return Jet(value, rate, plus(times(curve, squared), times(slope, a.bend)))


def integer_power(a: Jet, n: int) -> Jet:
    u = a.value
    slope = scaled(power(u, n - 1), float(n)) if n else None
    curve = scaled(power(u, n - 2), float(n * (n - 1))) if n * (n - 1) else None
    return composed(a, power(u, n), slope, curve)


def power_by(a: Jet, b: Jet) -> Jet:
    """a^b, by exp(b log a) where b moves: then a must be above 0."""
    if b.rate is not None or not b.value.exact:
        return exp(multiply(b, log(a)))
    p = b.value.low.astype(a.value.low.dtype)
    # Where a factor p or p - 1 is 0, so is the derivative, also where the power beside it is unknown.
    part = lambda factor, p: times(point(factor), _where(factor == 0, point(jnp.zeros_like(p)), power_of(a.value, p)))
    return composed(a, power_of(a.value, p), part(p, p - 1), part(p * (p - 1), p - 2))


def _where(condition, a: Interval, b: Interval) -> Interval:
    return Interval(jnp.where(condition, a.low, b.low), jnp.where(condition, a.high, b.high))


def inverse(a: Jet) -> Jet:
    u = reciprocal(a.value)
    return composed(a, u, negative(square(u)), scaled(power(u, 3), 2.0))


def divide(a: Jet, b: Jet) -> Jet:
    return multiply(a, inverse(b))


def exp(a: Jet) -> Jet:
    u = increasing(jnp.exp, a.value)
    return composed(a, u, u, u)


def log(a: Jet) -> Jet:
    u = reciprocal(a.value)
    return composed(a, increasing(jnp.log, a.value), u, negative(square(u)))


def root(a: Interval) -> Interval:
    """Range of a square root; of what lies below 0 that of 0."""
    return increasing(lambda x: jnp.sqrt(jnp.maximum(x, 0)), a)


def sqrt(a: Jet) -> Jet:
    u = root(a.value)
    slope = scaled(reciprocal(u), 0.5)
    return composed(a, u, slope, scaled(power(slope, 3), -2.0))


def sin(a: Jet) -> Jet:
    s, c = wave(jnp.sin, a.value, jnp.pi / 2), wave(jnp.cos, a.value, 0.0)
    return composed(a, s, c, negative(s))


def cos(a: Jet) -> Jet:
    s, c = wave(jnp.sin, a.value, jnp.pi / 2), wave(jnp.cos, a.value, 0.0)
    return composed(a, c, negative(s), negative(c))


def tanh(a: Jet) -> Jet:
    u = increasing(jnp.tanh, a.value)
    slope = plus(point(jnp.ones_like(u.low)), negative(square(u)))
    return composed(a, u, slope, scaled(times(u, slope), -2.0))


def logistic(a: Jet) -> Jet:
    half = tanh(scaled_jet(a, 0.5))
    return scaled_jet(add(half, constant(jnp.ones_like(a.value.low))), 0.5)


def erf(a: Jet) -> Jet:
    bell = exp(negate(integer_power(Jet(a.value, None, None), 2))).value
    slope = scaled(bell, float(2 / jnp.pi**0.5))
    return composed(a, increasing(lax.erf, a.value), slope, scaled(times(a.value, slope), -2.0))


def scaled_jet(a: Jet, factor: float) -> Jet:
    return Jet(*(scaled(part, factor) for part in a))


def constant(x) -> Jet:
    """An exact number that does not change."""
    return Jet(point(x), None, None)


def stepwise(f, a: Jet) -> Jet:
    """An increasing function of steps: without a rate where no step is met, unknown rates where one may be."""
    value = each(f, a.value)
    rate = point(jnp.where(value.low == value.high, 0.0, jnp.nan).astype(value.low.dtype))
    return Jet(value, rate, rate)


def chosen(truth: Truth, a: Jet, b: Jet, kink: bool) -> Jet:
    """`a` where the condition holds, else `b`; in doubt either. Where the two join without a jump (a `kink`), the rate
    is one of theirs; at a jump nothing is known of it."""
    doubt = truth.possible & ~truth.sure

    def part(x, y, joined) -> Any:
        if x is None and y is None and joined:
            return None
        zero = point(jnp.zeros_like(a.value.low + b.value.low))
        x, y = x or zero, y or zero
        unknown = jnp.full(zero.low.shape, jnp.nan, jnp.result_type(zero.low.dtype, float))  # no integer is nan
        between = hull(x, y) if joined else point(unknown)
        pick = lambda u, v, w: jnp.where(doubt, w, jnp.where(truth.sure, u, v))
        return Interval(pick(x.low, y.low, between.low), pick(x.high, y.high, between.high))

    return Jet(part(a.value, b.value, True), part(a.rate, b.rate, kink), part(a.bend, b.bend, False))


def maximum(a: Jet, b: Jet) -> Jet:
    x, y = a.value, b.value
    jet = chosen(Truth(x.low >= y.high, ~(y.low >= x.high)), a, b, kink=True)
    return jet._replace(value=Interval(jnp.maximum(x.low, y.low), jnp.maximum(x.high, y.high)))


def minimum(a: Jet, b: Jet) -> Jet:
    return negate(maximum(negate(a), negate(b)))


def absolute(a: Jet) -> Jet:
    jet = maximum(a, negate(a))
    return jet._replace(value=Interval(jnp.maximum(jet.value.low, 0), jet.value.high))


def less(a: Jet, b: Jet) -> Truth:
    """a < b"""
    return Truth(a.value.high < b.value.low, ~(a.value.low >= b.value.high))


def less_or_equal(a: Jet, b: Jet) -> Truth:
    """a <= b"""
    return negation(less(b, a))


def equal(a: Jet, b: Jet) -> Truth:
    """a == b"""
    x, y = a.value, b.value
    if a is b:  # whether a number is none, as `jnp.logaddexp` asks
        return Truth((x.low == x.low) & (x.high == x.high), jnp.ones_like(x.low, bool))
    sure = (x.low == x.high) & (y.low == y.high) & (x.low == y.low)
    return Truth(sure, ~((x.high < y.low) | (y.high < x.low)))


def negation(a: Truth) -> Truth:
    """not a"""
    return Truth(~a.possible, ~a.sure)
