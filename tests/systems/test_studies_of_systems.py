"""Every study takes a hybrid system where it takes a scene: sweep, check, compare, work-precision, fit, growth."""

import diffrax
import jax.numpy as jnp
import numpy as np
import pytest

import hybridsens as hs
from tests.closeness import assert_close
from tests.problems.hybrid_systems import Neuron, Thermostat

NEURON = Neuron(jnp.array(0.5), jnp.array(0.3))


def third_spike(neuron, solve):
    return solve(neuron, {"v": 0.0, "i": 1.6}, t1=1.6).events.time[2]


def third_spike_by(tau, w):
    """Closed form: spike k comes tau log(i_k / (i_k - 1)) after the one before."""
    current = 1.6 + w * np.arange(3)
    return tau * np.sum(np.log(current / (current - 1)))


@pytest.mark.slow
def test_a_sweep_of_a_system():
    """Values, derivatives, events and states of a grid, under the names of the system's parameters and leaves."""

    def cost(neuron):
        solution = hs.solve(
            neuron, {"v": 0.0, "i": 1.6}, t1=1.6, ts=jnp.array([0.1, 1.6]), max_events=12, max_steps=1024, throw=False
        )
        return solution.events.time[2], solution

    design = hs.grid(NEURON, {"tau": np.array([0.4, 0.5]), "w": np.array([0.3, 0.4, 0.5])})
    found = hs.sweep(cost, design, states=True, events=3, progress=False)
    expected = np.array([[third_spike_by(tau, w) for w in (0.3, 0.4, 0.5)] for tau in (0.4, 0.5)])
    assert_close(found["J"].values, expected, 1e-7)
    assert_close(found["dJ_dtau"].values, expected / np.array([[0.4], [0.5]]), 1e-7)
    assert found["event_guard"].values.tolist() == np.zeros((2, 3, 3), int).tolist()
    assert found["x.i"].shape == found["x.v"].shape == (2, 3, 2)
    assert_close(found["x.i"].values[..., 0], np.full((2, 3), 1.6), 1e-12)


@pytest.mark.slow
def test_a_check_of_a_system():
    """All agree."""
    check = hs.check_gradient(NEURON, third_spike)
    assert check.ok and [entry.parameter for entry in check.parameters] == ["tau", "w"]
    assert "All agree.\nAt the default tolerance" in str(check) and "determinant" not in str(check)
    assert check.at_default.deviation < 1e-6


@pytest.mark.slow
def test_a_check_of_a_system_whose_derivative_is_not_that_of_its_function():
    class Broken(Neuron):
        def transition(self, event, t, x, mode):
            after, mode = super().transition(event, t, x, mode)
            return {**after, "i": after["i"] + 1e-3 * jnp.floor(self.w * 1e3)}, mode

    broken = hs.check_gradient(Broken(jnp.array(0.5), jnp.array(0.3)), third_spike)
    assert [entry.parameter for entry in broken.parameters if entry.verdict] == ["w"]


@pytest.mark.slow
def test_a_comparison_of_a_system():
    """Our rows are right. The loop that holds the events' times constant has a right value and a wrong gradient."""
    cost = lambda neuron, solve: solve(neuron, {"v": 0.0, "i": 1.6}, t1=1.6).final["v"]
    table = hs.compare(NEURON, cost, adjoints=(hs.Replay(), hs.ForwardSensitivities()), steps=20_000, progress=False)
    assert [row.failure for row in table.rows] == 4 * [""]
    errors = {row.method: (row.value_error, row.gradient_error) for row in table.rows}
    assert max(errors["Replay"] + errors["ForwardSensitivities"]) < 1e-6
    assert errors["autodiff, `where` transition"][0] < 1e-2 and errors["autodiff, `where` transition"][1] > 0.1


@pytest.mark.slow
def test_work_and_precision_of_a_system():
    """Errors fall with the tolerance."""
    study = hs.work_precision(
        NEURON, third_spike, solvers=(diffrax.Tsit5(),), tolerances=(1e-5, 1e-9), methods=(hs.Replay(),), progress=False
    )
    rough, fine = (point.gradient_error for point in study.points)
    assert fine < 1e-7 < rough < 1e-2


@pytest.mark.slow
@pytest.mark.parametrize("seen", ["states", "events"])
def test_a_fit_of_a_system(seen):
    """Two thresholds and the loss of heat, from temperatures or from the times of the switches alone."""
    truth = dict(a=0.3, outside=10.0, heat=9.0, low=18.0, high=22.0)
    room = lambda **changed: Thermostat(**{name: jnp.array(value) for name, value in (truth | changed).items()})
    start, off = {"inside": 20.0}, {"on": False, "count": 0}
    times = np.linspace(0.1, 4.0, 40)
    record = hs.solve(room(), start, off, t1=4.0, ts=jnp.asarray(times), max_events=16)
    switches = np.asarray(record.events.time)[: int(record.events.count)]
    assert switches.size == 4
    if seen == "states":
        data = hs.measurements(times, record.x["inside"], names=["inside"])
    else:
        data = hs.measurements(event_times=switches, event_sigma=1e-3)
    fitted = ["low", "high"] if seen == "events" else ["a", "low", "high"]
    found = hs.fit(
        room(low=17.8, high=22.3, a=0.3 if seen == "events" else 0.31), data, parameters=fitted, state=start, mode=off,
        max_events=16, t1=4.0,
    )  # fmt: skip
    assert_close(found.values, np.array([truth[name] for name in fitted]), 1e-6)
    assert found.sequence_end[:3] == (("event", 0),) * 3
    assert "low" in str(found)
    assert found.plot().axes[0].get_xlabel() == "time"  # hours, as it happens
    assert "units" not in found.to_xarray().time.attrs


@pytest.mark.slow
def test_growth_of_a_system():
    """A thermostat's deviations die at its second switch, since its temperature there is the threshold itself."""
    room = Thermostat(*(jnp.array(p) for p in (0.3, 10.0, 9.0, 18.0, 22.0)))
    before = hs.lyapunov(room, {"inside": jnp.array(20.0)}, {"on": False, "count": 0}, t1=0.7)
    assert_close(before.exponent, -0.3, 1e-7)
    flow_off, flow_on = 0.3 * (10 - 18), 0.3 * (10 - 18) + 9
    after = hs.lyapunov(room, {"inside": jnp.array(20.0)}, {"on": False, "count": 0}, t1=1.0)
    assert_close(after.growth, np.exp(-0.3) * abs(flow_on / flow_off), 1e-6)
