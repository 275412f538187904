"""Systems whose comparisons are events: against modes written by hand, closed forms and differences."""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest

import hybridsens

TOLERANCES = {"rtol": 1e-10, "atol": 1e-10}


class Spring(hybridsens.AbstractHybridSystem):
    """q'' = -k q, with another force where q is above a place."""

    located_discontinuities = True
    k: jax.Array
    force: jax.Array
    place: jax.Array

    def flow(self, t, x, mode):
        return {"q": x["v"], "v": -self.k * x["q"] + jnp.where(x["q"] > self.place, self.force, 0.0)}

    def guards(self, t, x, mode):
        return jnp.zeros(0)

    def transition(self, event, t, x, mode):
        return x, mode


class SpringInModes(Spring):
    """The same by a mode."""

    located_discontinuities = False

    def flow(self, t, x, mode):
        return {"q": x["v"], "v": -self.k * x["q"] + jnp.where(mode, self.force, 0.0)}

    def guards(self, t, x, mode):
        return jnp.where(mode, 1, -1) * (x["q"] - self.place)[None]

    def transition(self, event, t, x, mode):
        return x, ~mode


START = {"q": 1.0, "v": 0.0}


def moved(system, mode=None, **options):
    return hybridsens.solve(system, START, mode, t1=4.0, **(TOLERANCES | options))


@pytest.mark.filterwarnings("error::hybridsens.DiscontinuityWarning")
def test_a_force_that_jumps_has_the_motion_and_the_gradient_of_a_mode():
    spring, by_mode = (kind(4.0, -1.0, 0.3) for kind in (Spring, SpringInModes))
    cost = lambda system, mode: (lambda s: s.final["q"] + 2 * s.events.time[1])(moved(system, mode))
    one, other = (eqx.filter_value_and_grad(cost)(*given) for given in ((spring, None), (by_mode, jnp.array(True))))
    np.testing.assert_allclose(one[0], other[0], atol=1e-9)
    np.testing.assert_allclose(jax.tree.leaves(one[1]), jax.tree.leaves(other[1]), atol=1e-8)
    solution = moved(spring)
    assert int(solution.events.count) == 3 and solution.mode is None and solution.events.mode is None
    np.testing.assert_allclose(solution.events.before["q"][:3], 0.3, atol=1e-9)


def test_without_it_the_gradient_is_another_and_a_warning_says_so():
    class Plain(Spring):
        located_discontinuities = False

    cost = lambda system: moved(system).final["q"]
    with pytest.warns(hybridsens.DiscontinuityWarning, match="located_discontinuities"):
        plain = eqx.filter_grad(cost)(Plain(4.0, -1.0, 0.3))
    assert abs(plain.place - eqx.filter_grad(cost)(Spring(4.0, -1.0, 0.3)).place) > 0.1


class Dosed(hybridsens.AbstractHybridSystem):
    """c' = -rate max(c - 1, 0) - c / 10: doses at known times, a refill where c falls to 0.5, a pulse of time."""

    located_discontinuities = True
    rate: jax.Array
    doses: jax.Array
    until: jax.Array

    def flow(self, t, x, mode):
        return -self.rate * jnp.maximum(x - 1, 0) - x / 10 + jnp.where(t < self.until, 0.3, 0.0)

    def guards(self, t, x, mode):
        return (x - 0.5)[None]

    def transition(self, event, t, x, mode):
        return x + jnp.where(event == 0, 1.0, 0.7), mode + jnp.where(event == 0, 1, 10)

    def scheduled_times(self, x, mode):
        return self.doses


@pytest.fixture(scope="module")
def dosed():
    return Dosed(0.8, jnp.array([1.0, 2.5]), jnp.array(1.7))


def concentration(system, **options):
    cost = lambda system, t, x, mode: jnp.abs(x - 0.8)
    return hybridsens.solve(system, 0.6, 0, t1=12.0, running_cost=cost, **(TOLERANCES | options))


def test_own_guards_and_scheduled_times_keep_their_numbers(dosed):
    """Comparisons come behind: 0 is the guard, 1 and 2 the doses, 3 and more what is compared."""
    solution = concentration(dosed)
    guard, count = np.asarray(solution.events.guard), int(solution.events.count)
    assert {0, 1, 2} < set(guard[:count].tolist()) and max(guard) == 5 and set(guard[count:].tolist()) == {-1}
    assert int(solution.mode) == np.sum(guard == 0) + 20 and solution.events.mode.shape == guard.shape
    np.testing.assert_allclose(solution.events.time[(guard == 1) | (guard == 2)], [1.0, 2.5])


METHODS = [
    pytest.param(hybridsens.Replay(), id="reverse"),
    pytest.param(hybridsens.ForwardSensitivities(), id="forward", marks=pytest.mark.slow),
]


@pytest.mark.parametrize("method", METHODS)
def test_gradients_are_those_of_differences(dosed, method):
    """By a rate, by the doses' times and by the end of the pulse, of the state and of the running cost."""
    differentiate = jax.jacrev if isinstance(method, hybridsens.Replay) else jax.jacfwd
    vector = lambda values: Dosed(values[0], values[1:3], values[3])
    at = jnp.array([0.8, 1.0, 2.5, 1.7])

    def results(values, **options):
        solution = concentration(vector(values), **options)
        return jnp.stack([solution.final, solution.cost])

    found = jax.jit(differentiate(lambda values: results(values, adjoint=method)))(at)
    ways = 1e-5 * jnp.concatenate([jnp.eye(4), -jnp.eye(4)])
    each = jax.jit(jax.vmap(results))(at + ways)
    np.testing.assert_allclose(found, (each[:4] - each[4:]).T / 2e-5, atol=2e-7)


def test_drag_from_rest_has_its_closed_form():
    """v' = 1 - v |v| begins on the surface v = 0: v = tanh t, and its derivative by v0 is 1 / cosh^2 t."""

    class Falling(hybridsens.AbstractHybridSystem):
        located_discontinuities = True

        def flow(self, t, x, mode):
            return 1 - x * jnp.abs(x)

        def guards(self, t, x, mode):
            return jnp.zeros(0)

        def transition(self, event, t, x, mode):
            return x, mode

    final = lambda v0: hybridsens.solve(Falling(), v0, t1=1.5, **TOLERANCES).final
    value, slope = jax.value_and_grad(final)(0.0)
    np.testing.assert_allclose([value, slope], [np.tanh(1.5), np.cosh(1.5) ** -2], atol=1e-8)


def test_a_motion_that_slides_along_a_jump_is_refused():
    """x' = -sign(x) stays on 0, which no mode describes."""

    class Sliding(hybridsens.AbstractHybridSystem):
        located_discontinuities = True

        def flow(self, t, x, mode):
            return -jnp.sign(x)

        def guards(self, t, x, mode):
            return jnp.zeros(0)

        def transition(self, event, t, x, mode):
            return x, mode

    solution = hybridsens.solve(Sliding(), 0.5, t1=1.0, throw=False)
    assert not bool(solution.status.reached_end) and float(solution.events.time[0]) == pytest.approx(0.5)
    with pytest.raises(hybridsens.SimulationError, match="The last events: t = 0.5, comparison 0"):
        hybridsens.solve(Sliding(), 0.5, t1=1.0)


def test_what_no_comparison_of_numbers_tells_is_warned_of_still():
    class Sorted(Spring):
        def flow(self, t, x, mode):
            return {"q": x["v"], "v": -jnp.sort(jnp.stack([4 * x["q"], x["v"], t]))[1] - jnp.abs(x["v"])}

    with pytest.warns(hybridsens.DiscontinuityWarning, match=r"`flow` must be smooth, but has jnp\.sort of t and x\."):
        moved(Sorted(4.0, -1.0, 0.3), throw=False)


class PulseWidth(hybridsens.AbstractHybridSystem):
    """A pulse of height 2 in each period, and a sawtooth."""

    located_discontinuities = True
    period: jax.Array
    duty: jax.Array

    def flow(self, t, x, mode):
        since_tick = t % self.period
        return 2 * jnp.where(since_tick < self.duty * self.period, 1.0, 0.0) + since_tick

    def guards(self, t, x, mode):
        return jnp.zeros(0)

    def transition(self, event, t, x, mode):
        return x, mode


@pytest.mark.filterwarnings("error::hybridsens.DiscontinuityWarning")
def test_a_remainder_of_time_ticks():
    """Until t = 2 there are three pulses of length 0.35 * 0.7 and two and a part teeth; a tick ends a tooth, and
    begins a pulse."""
    final = lambda period, duty: hybridsens.solve(PulseWidth(period, duty), 0.0, t1=2.0, **TOLERANCES).final
    value, slopes = jax.value_and_grad(final, (0, 1))(jnp.array(0.7), jnp.array(0.35))
    teeth, by_period = 0.7**2 + 0.6**2 / 2, 2 * 0.7 - 2 * 0.6
    np.testing.assert_allclose(value, 6 * 0.35 * 0.7 + teeth, atol=1e-9)
    np.testing.assert_allclose(slopes, [6 * 0.35 + by_period, 6 * 0.7], atol=1e-8)


def test_a_bound_at_infinity_is_never_met():
    class Bounded(Spring):
        def flow(self, t, x, mode):
            return {"q": x["v"], "v": -jnp.clip(self.k * x["q"], -self.force, jnp.inf)}

    solution = moved(Bounded(4.0, jnp.inf, 0.3))
    assert float(solution.final["q"]) == pytest.approx(np.cos(8.0), abs=1e-8) and int(solution.events.count) == 0


def test_a_system_that_compares_nothing_is_left_as_it_is():
    class Smooth(SpringInModes):
        located_discontinuities = True

        def guards(self, t, x, mode):
            return jnp.where(mode, 1.0, -1.0) * (x["q"] - self.place)[None]

    one, other = (moved(kind(4.0, -1.0, 0.3), jnp.array(True)) for kind in (Smooth, SpringInModes))
    assert (one.final, one.steps) == (other.final, other.steps)


class Counted(hybridsens.AbstractHybridSystem):
    """x falls to 0 and is raised by 1, at twice the rate from the second time on: the count is a part of the state."""

    located_discontinuities = True
    rate: jax.Array

    def flow(self, t, x, mode):
        fast = (x["count"] >= 2) & (jax.nn.relu(x["level"]) > -1)
        return {"level": -self.rate * jnp.where(fast, 2.0, 1.0), "count": jnp.zeros(())}

    def guards(self, t, x, mode):
        return x["level"][None]

    def transition(self, event, t, x, mode):
        return {"level": x["level"] + 1, "count": x["count"] + 1}, mode


def test_a_count_that_comes_to_the_number_it_is_compared_with_counts():
    """It stands still there, so no guard falls. After the second raise the level is 1, then 2 rate (2.3 - 2 / rate) is
    lost, and it is raised once more."""
    final = lambda rate: hybridsens.solve(Counted(rate), {"level": 1.0, "count": 0.0}, t1=2.3).final["level"]
    value, slope = jax.value_and_grad(final)(jnp.array(1.1))
    np.testing.assert_allclose([value, slope], [6 - 4.6 * 1.1, -4.6], atol=1e-8)


def test_a_comparison_made_of_another_turns_with_it():
    """The overlap stays 0 below the place, so that nothing tells there that it is not above 0: its outcome changes with
    that of the choice that it is made of."""

    class Overlapping(Spring):
        def flow(self, t, x, mode):
            overlap = jnp.maximum(x["q"] - self.place, 0)
            return {"q": x["v"], "v": -self.k * x["q"] + jnp.where(overlap > 0, self.force, 0.0)}

    spring, by_mode = (kind(4.0, -1.0, 0.3) for kind in (Overlapping, SpringInModes))
    one, other = (moved(*given).final["q"] for given in ((spring, None), (by_mode, jnp.array(True))))
    np.testing.assert_allclose(one, other, atol=1e-9)
