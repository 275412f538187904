"""Interval arithmetic holds what it claims: every sampled value lies within the bounds."""

import functools

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from hypothesis import Phase, given, settings
from hypothesis import strategies as st

from hybridsens.interval.arithmetic import Interval, point
from hybridsens.interval.enclosure import enclose
from hybridsens.interval.jet import Jet
from hybridsens.interval.kind import Kind, kinds

SAMPLES = 41
WHICH = jnp.array([1])
WEIGHTS = np.array([1.0, 2.0, 4.0])
MATRIX = np.array([[1.0, -2.0], [0.5, 3.0]])
TABLE = np.array([[-1.0, -0.2, 0.1, 0.8], [0.3, -1.0, 1.2, 0.5]])
"""Places, and values there."""
FUNCTIONS = {
    "polynomial": lambda x, y: x**3 - 2 * x * x * y + y**2 - 1.5,
    "quotient": lambda x, y: x / (2 + y * y) - 1 / (3 + jnp.sin(x)),
    "powers": lambda x, y: (x - 0.71) ** 2.0 - 0.3 * (y + 0.32) ** 3.0 + (x - 20) ** jnp.array(-2.0),
    "a power of 1": lambda x, y: (y - 0.1) ** WHICH[0] * x,
    "a power of a root": lambda x, y: (4 + y) ** jnp.array(1.5) * (x + 0.1) ** jnp.array(4.0),
    "written entries": lambda x, y: MATRIX[0] @ jnp.array([1.0, 2.0]).at[WHICH[0]].set(x * y).at[0].add(jnp.sin(x)),
    "written cases": lambda x, y: jnp.where((jnp.stack([x, y]) > 0.2).at[WHICH[0]].set(x > y), x, x * y) @ MATRIX[1],
    "a written slice": lambda x, y: jax.lax.dynamic_update_slice(jnp.stack([x, y, x * y]), (y * y)[None], (1,)).sum(),
    "cut into pieces": lambda x, y: (lambda a, b: a @ b)(*jnp.split(jnp.stack([x, y, x * y, jnp.sin(x)]), 2)),
    "cut cases": lambda x, y: jnp.where(jnp.split(jnp.stack([x > y, y > 0.2]), 2)[1][0], x, x * y),
    "unpacked": lambda x, y: (lambda a, b: a * a - jnp.cos(b))(*jnp.stack([x, y])),
    "outer products": lambda x, y: MATRIX[0] @ jnp.einsum("i,j->ij", *2 * [jnp.stack([x, y])]) @ MATRIX[1],
    "products by entry": lambda x, y: MATRIX[0] @ jnp.einsum("i,i->i", *2 * [jnp.stack([x, y])]),
    "waves": lambda x, y: jnp.sin(3 * x) * jnp.cos(x - y) + jnp.tan(0.3 * y),
    "bells": lambda x, y: jnp.exp(-((x / 0.2) ** 2)) + jnp.exp2(y) * jnp.expm1(x),
    "roots": lambda x, y: jnp.sqrt(x * x + y * y + 0.1) + jax.lax.rsqrt(1 + jnp.exp(y)) + jnp.log1p(y * y),
    "logarithm": lambda x, y: jnp.log(5 + x) * (5 + y) ** 1.3,
    "steps": lambda x, y: jnp.tanh(4 * x) + jax.nn.sigmoid(y) + jax.scipy.special.erf(x * y) + jnp.arctan(x + y),
    "angles": lambda x, y: jnp.arcsin(jnp.sin(x) * 0.9) - jnp.arccos(jnp.cos(y) * 0.8),
    "direction": lambda x, y: jnp.arctan2(y, x + 3) + jnp.arctan2(y + 4, x) * jnp.arctan2(y - 5, x),
    "any direction": lambda x, y: jnp.arctan2(x, y) + jnp.arctan2(x, 2.0),
    "inverses": lambda x, y: jnp.arcsinh(3 * x) + jnp.arccosh(1.1 + y * y) * jnp.arctanh(0.9 * jnp.sin(x)),
    "cube roots": lambda x, y: jnp.cbrt(x * x + 0.1) - jnp.cbrt(y - 9),
    "hyperbolic": lambda x, y: jnp.sinh(x) - jnp.cosh(y),
    "kinks": lambda x, y: jnp.abs(x) + jnp.maximum(x, y) - jnp.minimum(2 * x, 1.0) + jnp.clip(y, -0.5, 0.5),
    "cases": lambda x, y: jnp.where(x > y, x - y, jnp.where((x < 0) & ~(y <= 0), 1.0, x * y)),
    "stacked cases": lambda x, y: WEIGHTS @ jnp.where(jnp.stack([x > 0.3, y < x, False]), jnp.stack([x, y, y]), 2 * x),
    "picked cases": lambda x, y: jnp.where(jnp.concatenate([x[None] > y, y[None] > 0.2])[::-1][WHICH[0]], x, x * y),
    "cases of cases": lambda x, y: jnp.where(jnp.where(x > y, x > 0.2, y > 0.1) == (y > 0.3), x, x * y),
    "rounded corner": lambda x, y: jnp.logaddexp(3 * x, y + 0.2),
    "cases by constants": lambda x, y: jnp.where(jnp.where(MATRIX[0] > 0, x > y, y > 0), x, y) @ MATRIX[1],
    "tables": lambda x, y: y * jnp.interp(x, *TABLE) - MATRIX[0] @ jnp.interp(jnp.stack([x * y, y]), *TABLE),
    "a table of integers": lambda x, y: jnp.interp(3 * x, np.arange(-1, 3), jnp.array([2, 0, 1, -1])) * y,
    "a table that jumps": lambda x, y: jnp.interp(x + y, jnp.array([-0.5, 0.2, 0.2, 0.9]), TABLE[1]),
    "branches": lambda x, y: jax.lax.switch(WHICH[0], [lambda: x + y, lambda: jnp.where(x > y, 1.0, x * y)]),
    "jumps": lambda x, y: jnp.sign(x) + jnp.floor(3 * y) + (x >= 0.5) * y,
    "integers": lambda x, y: x - jnp.where(x > y, 0, 1),
    "products": lambda x, y: jnp.stack([x, y]) @ (MATRIX @ jnp.stack([x * y, jnp.cos(y)])) + jnp.dot(x[None], x[None]),
    "shapes": lambda x, y: jnp.cumsum(jnp.concatenate([x[None], MATRIX[1] * y]))[::-1].reshape(3, 1).T.sum(),
}
QUICK = (
    "quotient", "powers", "a power of a root", "written cases", "cut into pieces", "waves", "bells", "roots",
    "logarithm", "steps", "direction", "inverses", "kinks", "cases", "tables", "branches", "jumps", "products",
)  # fmt: skip
CASES = [pytest.param(name, marks=[pytest.mark.slow] * (name not in QUICK)) for name in FUNCTIONS]


def path(s, numbers):
    """A cubic in s for x and one for y."""
    a, b = jnp.asarray(numbers).reshape(2, 4)
    return [c[0] + c[1] * s + c[2] * s**2 + c[3] * s**3 for c in (a, b)]


def jets(numbers, low, width):
    """Exact ranges of x and y along a stretch of their paths, by a thousand samples and their ends."""
    s = np.linspace(low, low + width, 1001)
    made = []
    for c in np.asarray(numbers).reshape(2, 4):
        value, rate, bend = np.polynomial.Polynomial(c), *(np.polynomial.Polynomial(c).deriv(k) for k in (1, 2))
        parts = [value(s), rate(s), bend(s)]
        slack = [np.abs(np.diff(p)).max() for p in parts]
        bounds_of = lambda p, e: Interval(jnp.array(p.min() - e), jnp.array(p.max() + e))
        made.append(Jet(*map(bounds_of, parts, slack)))
    return made


@functools.cache
def bounds(name):
    """Compiled: bounds of f, f', f'' along a stretch; and their values at a place."""
    function = FUNCTIONS[name]
    trace = jax.make_jaxpr(function)(0.0, 0.0)

    def enclosed(x, y):
        jet = enclose(trace, [x, y])
        zero = point(jnp.zeros_like(jet.value.low))
        return [part or zero for part in jet]

    def along(numbers):
        f = lambda s: function(*path(s, numbers))
        return lambda s: jnp.stack([f(s), jax.grad(f)(s), jax.grad(jax.grad(f))(s)])

    return jax.jit(enclosed), jax.jit(lambda numbers, s: jax.vmap(along(numbers))(s))


@pytest.mark.parametrize("name", CASES)
@settings(max_examples=40, deadline=None, derandomize=True, phases=[Phase.generate])
@given(numbers=st.lists(st.floats(-1.5, 1.5), min_size=8, max_size=8), low=st.floats(0, 1), power=st.integers(0, 20))
def test_values_and_derivatives_lie_within_their_bounds(name, numbers, low, power):
    """Along cubics in s, stretches of length 1 to 1e-6; where bounds of a derivative are unknown, none is claimed."""
    enclosed, along = bounds(name)
    parts = enclosed(*jets(numbers, low, 2.0**-power))
    values = np.asarray(along(jnp.array(numbers), low + 2.0**-power * jnp.linspace(0, 1, SAMPLES)))
    for order, (part, samples) in enumerate(zip(parts, values.T, strict=True)):
        if np.isnan(part.low) or np.isnan(part.high):
            assert order > 0 or power < 3
            continue
        rounded = 1e-13 * (1 + np.abs(samples).max())
        assert np.all(samples >= part.low - rounded) and np.all(samples <= part.high + rounded)


@pytest.mark.parametrize("name", CASES)
def test_bounds_close_in_on_a_short_stretch(name):
    """The range of f over a stretch of 1e-6 is no wider than 1e-4: bounds that are too wide would prove nothing."""
    numbers = [0.3, 0.4, -0.2, 0.1, -0.7, 0.5, 0.3, -0.6]
    jet = bounds(name)[0](*jets(numbers, 0.2, 1e-6))
    assert jet[0].high - jet[0].low < 1e-4
    assert jet[2].high - jet[2].low < 1e-2


OUTSIDE = {"asin": jnp.arcsin, "acos": jnp.arccos, "acosh": jnp.arccosh, "atanh": jnp.arctanh, "cbrt": jnp.cbrt}


@pytest.mark.parametrize("name", OUTSIDE)
def test_bounds_hold_or_are_unknown_at_the_edge_of_a_domain_and_outside(name):
    """Of value, slope and curvature over random stretches of s in [-3, 3], wherever there is one."""
    function, rng = OUTSIDE[name], np.random.default_rng(0)
    ends = np.sort(np.concatenate([rng.uniform(-3, 3, (200, 2)), [[-1, 1], [1, 2], [0, 1], [-1, 0], [0, 0.5]]]), 1)
    trace = jax.make_jaxpr(function)(jnp.zeros(len(ends)))
    jet = enclose(trace, [Jet(Interval(*jnp.array(ends.T)), point(jnp.ones(len(ends))), None)])
    derivatives = [function, jax.grad(function), jax.grad(jax.grad(function))]
    s = jnp.array(ends[:, :1] + np.diff(ends) * np.linspace(0, 1, SAMPLES))
    for part, derivative in zip(jet, derivatives, strict=True):
        samples = np.asarray(jax.vmap(jax.vmap(derivative))(s))
        known = ~np.isnan(part.low) & ~np.isnan(part.high)
        slack = 1e-13 * (1 + np.abs(np.nan_to_num(samples, posinf=0, neginf=0)))
        inside = (samples >= part.low[:, None] - slack) & (samples <= part.high[:, None] + slack)
        assert np.all(inside[known] | np.isnan(samples[known]))
        assert known.any()
    outside = np.isnan(np.asarray(function(s))).all(1)
    assert np.isnan(np.asarray(jet.value.low))[outside].all()


def test_kinds_are_told_entry_by_entry():
    """Constant, affine, curved and unknown, beside each other in one result."""
    table = jnp.arange(4.0)
    by_mode = lambda q: jax.lax.switch(WHICH[0], [lambda q: 2 * q[0], lambda q: 1 - q[1]], q)

    def gap(t, q):
        unknown = jnp.interp(q[0], table, table, left="extrapolate")
        return jnp.stack([table[1], 2 * q[0] - t / 3, q[0] * q[1], unknown, jnp.where(q[1] > 0, 1.0, 2.0), by_mode(q)])

    trace = jax.make_jaxpr(gap)(0.0, jnp.zeros(2))
    found = kinds(trace, [np.full(x.shape, Kind.AFFINE) for x in trace.in_avals])
    assert found.tolist() == [Kind.CONSTANT, Kind.AFFINE, Kind.CURVED, Kind.UNKNOWN, Kind.CURVED, Kind.AFFINE]


@pytest.mark.parametrize(
    "choose",
    [
        lambda x, y: jnp.select([x < -0.5, x < 0.5], [y, 0 * x], x),
        lambda x, y: jnp.piecewise(x, [x < 0], [jnp.sin, y]),
        lambda x, y: x * (1 + (y > x)),
    ],
    ids=["select", "piecewise", "count"],
)
def test_what_goes_by_a_number_that_moves_is_unknown(choose):
    """In bounds and in kinds alike, so that it is sampled."""
    trace = jax.make_jaxpr(choose)(0.0, 0.0)
    jet = enclose(trace, jets([0.3, 0.4, -0.2, 0.1, -0.7, 0.5, 0.3, -0.6], 0.2, 0.1))
    assert np.isnan(jet.value.low) and kinds(trace, [np.array(Kind.AFFINE)] * 2) == Kind.UNKNOWN
