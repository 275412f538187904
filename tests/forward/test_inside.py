"""A glance lets most steps through; whatever it lets through, the rules of the event location find nothing in."""

import jax
import jax.numpy as jnp
import numpy as np

from hybridsens.flat_system import StepEnds
from hybridsens.forward import inside
from hybridsens.forward.guards import GuardsAtStart
from hybridsens.forward.inside import Before

CASES, GUARDS = 100_000, 2


def steps_and_glances(seed):
    """Random steps whose guards are small, large, bent, falling and rising; what a glance and a look say of them."""
    random = np.random.default_rng(seed)
    shape = (CASES, GUARDS)
    # Each of a guard's values, its rates and what bends it may be small beside the others.
    any_size = lambda: random.normal(size=shape) * 10.0 ** random.uniform(-10, 0, shape)
    rate0, rate1, bend = any_size(), any_size(), any_size()
    guard0 = np.abs(any_size()) + random.integers(0, 3, shape)
    guard1 = np.where(random.random(shape) < 0.2, np.abs(any_size()), guard0 + (rate0 + rate1) / 2 + bend)
    h = 10.0 ** random.uniform(-6, 1, CASES)
    noise = np.where(random.random(shape) < 0.2, 1e-9, 0.0)

    def one(guard0, guard1, rate0, rate1, h, noise):
        none = jnp.zeros((0,))
        t0 = jnp.asarray(1.0)
        step = StepEnds(t0, none, jnp.maximum(guard0, 0), rate0 / h, t0 + h, none, guard1, rate1 / h, none, 5)
        leaving = jnp.zeros(GUARDS, bool)
        start = GuardsAtStart(guard0, rate0 / h, noise, jnp.full(GUARDS, 1e-14), leaving, leaving)
        before = Before(start, noise, jnp.array(0), jnp.asarray(20.0), jnp.full(GUARDS, 1e-8))
        return inside._is_far_from_guards(step, before), inside._look(step, before)

    return jax.jit(jax.vmap(one))(guard0, guard1, rate0, rate1, h, noise)


def test_nothing_is_found_in_a_step_that_a_glance_lets_through():
    for seed in range(10):
        far, found = steps_and_glances(seed)
        assert 0.05 < jnp.mean(far) < 0.95
        assert not jnp.any(far & found.ends_early)
        assert not jnp.any(far & jnp.isfinite(found.t_root))
        assert not jnp.any(far & jnp.isfinite(found.split))
        assert not jnp.any(far & (found.on_guard | found.grazes | ~found.known))


def test_a_guard_that_is_no_number_is_looked_at():
    for name in ("guard1", "rate1", "guard0"):
        two = lambda value: jnp.full(2, value)
        step = StepEnds(
            jnp.asarray(0.0), two(0.0), two(1.0), two(0.0), jnp.asarray(0.1), two(0.0), two(1.0), two(0.0), two(0.0), 5
        )
        no = jnp.zeros(2, bool)
        start = GuardsAtStart(two(1.0), two(0.0), two(0.0), two(1e-14), no, no)
        before = Before(start, two(0.0), jnp.array(0), jnp.asarray(1.0), two(1e-8))
        assert inside._is_far_from_guards(step, before)
        unknown = getattr(step, name).at[1].set(jnp.nan)
        assert not inside._is_far_from_guards(step._replace(**{name: unknown}), before)
