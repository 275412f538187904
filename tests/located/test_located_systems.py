"""Systems whose comparisons are events: against modes written by hand, closed forms and differences."""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest

import hybridsens
from tests.problems.springs import TOLERANCES, Spring, SpringInModes, moved


@pytest.mark.slow
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


@pytest.mark.slow
def test_without_it_the_gradient_is_another_and_says_so():
    """By a warning from the trace, and by the status of the motion whose derivative is taken."""

    class Plain(Spring):
        located_discontinuities = False

    cost = lambda system, **given: moved(system, **given).final["q"]
    with pytest.warns(hybridsens.DiscontinuityWarning, match="located_discontinuities"):
        plain = eqx.filter_grad(cost)(Plain(4.0, -1.0, 0.3), throw=False)
        with pytest.raises(hybridsens.SimulationError, match="flow_jumps"):
            eqx.filter_grad(cost)(Plain(4.0, -1.0, 0.3))
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


@pytest.mark.slow
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
    """x' = 1/5 - sign(x) stays on 0, which no mode describes. Without the load it rests there."""

    class Sliding(hybridsens.AbstractHybridSystem):
        load: jax.Array
        located_discontinuities = True

        def flow(self, t, x, mode):
            return self.load - jnp.sign(x)

        def guards(self, t, x, mode):
            return jnp.zeros(0)

        def transition(self, event, t, x, mode):
            return x, mode

    stopped = lambda load: hybridsens.solve(Sliding(jnp.array(load)), 0.5, t1=1.0, throw=False)
    slides, rests = stopped(0.2), stopped(0.0)
    assert "slides along a threshold or a comparison" in slides.status.message
    assert not bool(slides.status.reached_end) and float(slides.events.time[0]) == pytest.approx(0.5 / 0.8)
    assert rests.status == hybridsens.Status.successful and abs(rests.final) < 1e-15
    with pytest.raises(hybridsens.SimulationError, match="The last events: .*t = 0.625, comparison 0"):
        hybridsens.solve(Sliding(jnp.array(0.2)), 0.5, t1=1.0)


@pytest.mark.slow
def test_what_no_comparison_of_numbers_tells_is_warned_of_still():
    class Sorted(Spring):
        def flow(self, t, x, mode):
            return {"q": x["v"], "v": -jnp.sort(jnp.stack([4 * x["q"], x["v"], t]))[1] - jnp.abs(x["v"])}

    with pytest.warns(hybridsens.DiscontinuityWarning, match=r"`flow` must be smooth, but has jnp\.sort of t and x\."):
        moved(Sorted(4.0, -1.0, 0.3), throw=False)


@pytest.mark.slow
def test_a_bound_at_infinity_is_never_met():
    class Bounded(Spring):
        def flow(self, t, x, mode):
            return {"q": x["v"], "v": -jnp.clip(self.k * x["q"], -self.force, jnp.inf)}

    solution = moved(Bounded(4.0, jnp.inf, 0.3))
    assert float(solution.final["q"]) == pytest.approx(np.cos(8.0), abs=1e-8) and int(solution.events.count) == 0


@pytest.mark.slow
def test_a_system_that_compares_nothing_is_left_as_it_is():
    class Smooth(SpringInModes):
        located_discontinuities = True

        def guards(self, t, x, mode):
            return jnp.where(mode, 1.0, -1.0) * (x["q"] - self.place)[None]

    one, other = (moved(kind(4.0, -1.0, 0.3), jnp.array(True)) for kind in (Smooth, SpringInModes))
    assert (one.final, one.steps) == (other.final, other.steps)
