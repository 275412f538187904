"""What can only be sampled inside a step is told of, of a scene or a system; what has bounds is met in silence."""

import warnings

import equinox as eqx
import jax
import jax.numpy as jnp
import pytest

import hybridsens as hs
from hybridsens.search import gap_search
from tests.closeness import assert_close

AT, WIDTH = 3.537, 1e-3


def dip(of, x):
    """Below 0 by less than WIDTH from AT, first where x = AT - WIDTH; `of` has the sign of its argument."""
    return of(((x - AT) / WIDTH) ** 2 - 1)


TABLE = lambda z: jnp.interp(z, jnp.array([-1.0, 0.0, 1.0]), jnp.array([-1.0, 0.0, 1.0]), left="extrapolate")
BOUNDED = {
    "asin": lambda z: jnp.arcsin(z / (2 + jnp.sqrt(1 + z * z))),
    "acos": lambda z: jnp.pi / 2 - jnp.arccos(z / (2 + jnp.sqrt(1 + z * z))),
    "asinh": jnp.arcsinh,
    "acosh": lambda z: jnp.arccosh(z + 3) - jnp.arccosh(3.0),
    "atanh": lambda z: jnp.arctanh(z / (2 + jnp.sqrt(1 + z * z))),
    "atan2": lambda z: jnp.arctan2(z, 1.0),
    "cbrt": lambda z: jnp.cbrt(z + 9) - jnp.cbrt(9.0),
    "table": lambda z: jnp.interp(z, jnp.array([-1.0, 0.2, 1.0]), jnp.array([-1.0, 0.2, 5.0])),
}


class Runner(hs.AbstractHybridSystem):
    """x' = 1, counted where the first guard falls; the second one, which the mode picks, never does."""

    start: jax.Array
    known_discontinuities = True
    of: object = eqx.field(static=True, default=None)

    def flow(self, t, x, mode):
        return jnp.ones(())

    def guards(self, t, x, mode):
        return jnp.stack([dip(self.of, x), jax.lax.switch(mode, [lambda: 20 - x, lambda: 30 - x * x / 100])])

    def transition(self, event, t, x, mode):
        return x, mode + 1


class Rolling(hs.AbstractSwitchedScene):
    """The same of a body that rolls evenly above a floor far below."""

    start: jax.Array
    known_discontinuities = True
    of: object = eqx.field(static=True, default=None)

    def mass_matrix(self, q):
        return jnp.eye(1)

    def force(self, t, q, v, mode):
        return 0 * q

    def gap(self, t, q):
        return q + 10

    def restitution(self):
        return jnp.array([0.5])

    def switches(self, t, q, v, mode):
        return jnp.stack([20 - q[0], dip(self.of, q[0])])

    def switch(self, event, t, q, v, mode):
        return v, mode + 1


def run(of, **settings):
    settings = dict(t1=10.0, max_events=8) | settings
    return hs.solve(Runner(jnp.zeros(()), of), 0.0, 0, **settings)


def roll(of, **settings):
    settings = dict(t1=10.0, max_events=8) | settings
    return hs.simulate(Rolling(jnp.zeros(()), of), hs.State([0.0], [1.0]), 0, **settings)


WAYS = {"guards": (run, r"Guards \[0\] are read from"), "switches": (roll, r"Switches \[1\] are read from")}


@pytest.mark.slow
@pytest.mark.parametrize("name", ["guards", pytest.param("switches", marks=pytest.mark.slow)])
def test_what_is_sampled_is_told(name):
    """But for a longest step that is given: then the dip is met at AT - WIDTH."""
    move, words = WAYS[name]
    with pytest.warns(UserWarning, match=words):
        assert move(TABLE).events.count == 0
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        assert_close(move(TABLE, max_step=2 * WIDTH, max_steps=8192).events.time[0], AT - WIDTH, 1e-9)


@pytest.mark.slow
def test_a_search_that_is_given_up_leads_to_shorter_steps(monkeypatch):
    """With few looks at each step it cannot look through a long one; then the step ends earlier, and is no less
    searched."""
    monkeypatch.setattr(gap_search, "MOST_LOOKS", 3)
    motion = run(lambda z: jnp.arcsinh(z), max_steps=8192)  # its own function: one compiled before looks longer
    assert_close(motion.events.time[0], AT - WIDTH, 1e-9)


QUICK = ("table",)
"""The bounds of each of these functions have tests of their own."""


@pytest.mark.slow
@pytest.mark.parametrize(
    "name", [pytest.param(name, marks=[pytest.mark.slow] * (name not in QUICK)) for name in BOUNDED]
)
def test_a_dip_is_met_through_functions_with_bounds(name):
    """At AT - WIDTH, in steps as long as they like."""
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        assert_close(run(BOUNDED[name]).events.time[0], AT - WIDTH, 1e-9)
