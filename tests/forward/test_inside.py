"""A glance lets most steps through, and of many guards most blocks; whatever it lets through, the rules of the event
location find nothing in."""

import jax
import jax.numpy as jnp
import numpy as np

from hybridsens.flat_system import StepEnds
from hybridsens.forward import inside
from hybridsens.forward.inside import Resolution

CASES, GUARDS = 100_000, 2


def random_steps(seed, cases, guards):
    """Random steps whose guards are small, large, bent, falling and rising, the way to an event shortened or not."""
    random = np.random.default_rng(seed)
    shape = (cases, guards)
    # Each of a guard's values, its rates and what bends it may be small beside the others.
    any_size = lambda: random.normal(size=shape) * 10.0 ** random.uniform(-10, 0, shape)
    rate0, rate1, bend = any_size(), any_size(), any_size()
    guard0 = np.abs(any_size()) + random.integers(0, 3, shape)
    guard1 = np.where(random.random(shape) < 0.2, np.abs(any_size()), guard0 + (rate0 + rate1) / 2 + bend)
    h = 10.0 ** random.uniform(-6, 1, cases)
    noise = np.where(random.random(shape) < 0.2, 1e-9, 0.0)
    return guard0, guard1, rate0, rate1, h, noise, random.integers(0, 9, cases)


def step_and_resolution(guard0, guard1, rate0, rate1, h, noise, shortenings):
    none, t0 = jnp.zeros((0,)), jnp.asarray(1.0)
    step = StepEnds(t0, none, jnp.maximum(guard0, 0), rate0 / h, t0 + h, none, guard1, rate1 / h, none, 5)
    size = guard0.shape
    turns = (noise > 0) & (jnp.abs(guard1) < 1e-8)
    rounding, depth = jnp.full(size, 1e-14), jnp.full(size, 1e-8)
    stairs = inside.on_a_stair(step, h * jnp.where(noise > 0, 2.0, 0.5))  # some steps are as short as rounding allows
    return step, Resolution(rounding, noise, turns, shortenings, stairs, jnp.asarray(20.0), depth)


@jax.jit
@jax.vmap
def glance_and_look(*case):
    step, resolution = step_and_resolution(*case)
    far = ~jnp.any(inside._near(step, resolution))
    return far, inside._look(step, resolution), step.t1 - step.t0


def test_nothing_is_found_in_a_step_that_a_glance_lets_through():
    for seed in range(10):
        far, found, h = glance_and_look(*random_steps(seed, CASES, GUARDS))
        assert 0.05 < jnp.mean(far) < 0.95
        assert not jnp.any(far & found.root_before_stop)
        assert not jnp.any(far & jnp.isfinite(found.t_root))
        assert not jnp.any(far & jnp.isfinite(found.split))
        assert not jnp.any(far & (found.on_guard | found.grazes | ~found.finite))
        assert not jnp.any(far & (found.to_go < 0.1 * h))  # a step that was to end on an event fell short of it


def by_blocks(step, resolution):
    return inside._look_by_blocks(step, resolution, inside._near(step, resolution))


def test_many_guards_are_looked_at_block_by_block():
    """By blocks, the last of which overlaps the one before, the same is found as by all at once."""
    guards, cases = 2 * inside.BLOCK + 7, 300

    @jax.jit
    @jax.vmap
    def both_ways(mixed, *case):
        guard0, guard1, rate0, rate1, *rest = case
        # Most guards are far; the few that are not may stand in any block.
        fixed = (guard0, 5.0), (guard1, 5.0), (rate0, 0.0), (rate1, 0.0)
        parts = [jnp.where(mixed, part, far) for part, far in fixed]
        step, resolution = step_and_resolution(*parts, *rest)
        return inside._look(step, resolution), by_blocks(step, resolution)

    seen = np.zeros(2, int)
    for seed in range(5):
        case = random_steps(seed, cases, guards)
        mixed = np.random.default_rng(seed).random((cases, guards)) < 0.05
        at_once, in_blocks = both_ways(mixed, *case)
        for name in ("t_root", "root_before_stop", "grazes", "finite"):
            np.testing.assert_allclose(getattr(at_once, name), getattr(in_blocks, name), rtol=1e-14, err_msg=name)
        np.testing.assert_array_equal(np.isfinite(at_once.split), np.isfinite(in_blocks.split))
        seen += [int(jnp.sum(what)) for what in (at_once.root_before_stop, jnp.isfinite(at_once.split))]
    assert np.all(seen > 20), seen  # the comparison was of something


def one_step(guards, **falling):
    """A step whose guards stay at 1 but for these, which fall to a value by a rate times the step."""
    end, fall = np.ones(guards), np.zeros(guards)
    for name, (value, by) in falling.items():
        end[int(name[1:])], fall[int(name[1:])] = value, by
    full = lambda value: jnp.full(guards, value)
    end, fall = jnp.asarray(end), jnp.asarray(fall)
    return step_and_resolution(full(1.0), end, fall, fall, jnp.asarray(0.1), full(0.0), jnp.array(0))


def test_a_step_that_ends_on_guards_of_several_blocks_lands_on_the_one_that_fell_first():
    guards = 3 * inside.BLOCK + 5
    for first, second in ((3, 98), (98, 3), (40, 41)):
        fallen = {f"g{first}": (-1e-15, -1.0), f"g{second}": (0.0, -1.0)}
        found = by_blocks(*one_step(guards, **fallen))
        assert found.on_guard and found.landed_on == first, (first, second, found.landed_on)


def test_an_unknown_guard_in_one_block_splits_the_step_whatever_another_shows():
    step, resolution = one_step(3 * inside.BLOCK, g0=(-0.5, -1.5))
    assert by_blocks(step, resolution).root_before_stop
    found = by_blocks(step._replace(guard1=step.guard1.at[80].set(jnp.nan)), resolution)
    assert not found.finite and not found.root_before_stop and found.split == 0.5 and jnp.isinf(found.t_root)


def test_a_guard_that_is_no_number_is_looked_at():
    for name in ("guard1", "rate1", "guard0"):
        two = lambda value: jnp.full(2, value)
        step, resolution = step_and_resolution(
            two(1.0), two(1.0), two(0.0), two(0.0), jnp.asarray(0.1), two(0.0), jnp.array(0)
        )
        assert not jnp.any(inside._near(step, resolution))
        unknown = getattr(step, name).at[1].set(jnp.nan)
        assert jnp.any(inside._near(step._replace(**{name: unknown}), resolution))
