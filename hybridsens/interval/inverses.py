"""Inverse functions of jets: of angles, hyperbolic functions and the third power."""

import jax.numpy as jnp

from .arithmetic import (
    Interval,
    each,
    increasing,
    negative,
    outward,
    plus,
    point,
    power,
    reciprocal,
    scaled,
    square,
    times,
)
from .jet import Jet, Truth, add, chosen, composed, constant, divide, linear, negate, root, subtract


def atan(a: Jet) -> Jet:
    u = a.value
    slope = reciprocal(plus(point(jnp.ones_like(u.low)), square(u)))
    return composed(a, increasing(jnp.arctan, u), slope, scaled(times(u, square(slope)), -2.0))


def atan2(y: Jet, x: Jet) -> Jet:
    """The angle of (x, y), told from the axis that is further away; any angle, of unknown rates, where y = 0 >= x may
    be: there it jumps."""
    shape = jnp.broadcast_shapes(y.value.low.shape, x.value.low.shape)
    x, y = (linear(lambda part: jnp.broadcast_to(part, shape), jet) for jet in (x, y))
    half = jnp.full(shape, jnp.pi / 2, x.value.low.dtype)
    nothing = point(jnp.full_like(half, jnp.nan))
    from_side, quarter = negate(atan(divide(x, y))), constant(half)
    where = lambda condition, one, other: chosen(Truth(condition, condition), one, other, kink=True)
    angle = where(y.value.high < 0, subtract(from_side, quarter), Jet(outward(-2 * half, 2 * half), nothing, nothing))
    angle = where(y.value.low > 0, add(from_side, quarter), angle)
    right, aside = x.value.low, jnp.maximum(y.value.low, -y.value.high)
    return where((right > 0) & (right >= aside), atan(divide(y, x)), angle)


def asin(a: Jet) -> Jet:
    one = point(jnp.ones_like(a.value.low))
    slope = reciprocal(root(plus(one, negative(square(a.value)))))
    value = _within(jnp.arcsin, a.value, -1.0, 1.0)
    return composed(a, value, slope, times(a.value, power(slope, 3)))


def acos(a: Jet) -> Jet:
    return subtract(constant(jnp.full_like(a.value.low, jnp.pi / 2)), asin(a))


def asinh(a: Jet) -> Jet:
    slope = reciprocal(root(plus(point(jnp.ones_like(a.value.low)), square(a.value))))
    return composed(a, increasing(jnp.arcsinh, a.value), slope, negative(times(a.value, power(slope, 3))))


def acosh(a: Jet) -> Jet:
    slope = reciprocal(root(plus(square(a.value), point(-jnp.ones_like(a.value.low)))))
    value = _within(jnp.arccosh, a.value, 1.0, jnp.inf)
    return composed(a, value, slope, negative(times(a.value, power(slope, 3))))


def atanh(a: Jet) -> Jet:
    slope = reciprocal(plus(point(jnp.ones_like(a.value.low)), negative(square(a.value))))
    value = _within(jnp.arctanh, a.value, -1.0, 1.0)
    return composed(a, value, slope, scaled(times(a.value, square(slope)), 2.0))


def cbrt(a: Jet) -> Jet:
    u = increasing(jnp.cbrt, a.value)
    slope = scaled(reciprocal(square(u)), 1 / 3)
    return composed(a, u, slope, scaled(reciprocal(power(u, 5)), -2 / 9))


def _within(f, a: Interval, low: float, high: float) -> Interval:
    """Range of an increasing function where it is defined, from `low` to `high`: bounds that are too wide may reach
    outside. Unknown where all of the interval lies there."""
    slack = 16 * jnp.finfo(a.low.dtype).eps
    meets = (a.low <= high + slack) & (a.high >= low - slack)
    ends = increasing(f, each(lambda x: jnp.clip(x, low, high), a))
    return Interval(*(jnp.where(meets, end, jnp.nan) for end in ends))
