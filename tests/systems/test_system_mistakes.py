"""Mistakes that codes of this kind make, built in one by one: the tests of the ready-made systems must see each."""

import equinox as eqx
import jax
import jax.numpy as jnp
import pytest
from jax import lax

import hybridsens as hs
from hybridsens.adjoint import jump as rules
from tests.closeness import assert_close
from tests.problems.system_numbers import assert_rows_close, forward_mode, reverse_mode, truth

pytestmark = pytest.mark.slow


def event_time_held_fixed(right):
    return "jump", lambda system, event, flows, before, dt: right["jump"](system, event, flows, before, 0 * dt)


def guards_parameters_forgotten(right):
    return "fallen_guard", lambda system, event, t, x: right["fallen_guard"](_constant(system), event, t, x)


def guards_time_derivative_forgotten(right):
    return "fallen_guard", lambda system, event, t, x: right["fallen_guard"](system, event, lax.stop_gradient(t), x)


def _constant(system):
    return jax.tree.map(lambda leaf: lax.stop_gradient(leaf) if eqx.is_inexact_array(leaf) else leaf, system)


def flow_after_in_the_old_mode(right):
    def flows(system, event):
        after = system.flow(event.states.time, event.states.after, event.mode)
        return rules.Flows(right["flows_at"](system, event).before, after)

    return "flows_at", flows


def jump_of_the_running_cost_forgotten(right):
    def flows(system, event):
        given = right["flows_at"](system, event)
        return given._replace(after=given.after.at[-1].set(given.before[-1]))

    return "flows_at", flows


def resets_time_derivative_forgotten(right):
    def jump(system, event, flows, before, dt):
        done = right["jump"](system, event, flows, before, dt)
        after, _ = system.reset(event.decision, event.states.time, before + flows.before * dt)
        return done._replace(state=after - flows.after * dt, reported=done.reported._replace(after=after))

    return "jump", jump


class Lift(hs.AbstractHybridSystem):
    """x' = -1; at 0 it is lifted to 1 + more t."""

    more: jax.Array

    def flow(self, t, x, mode):
        return -jnp.ones(())

    def guards(self, t, x, mode):
        return x[None]

    def transition(self, event, t, x, mode):
        return 1.0 + self.more * t, mode


def check_lift(way):
    """x(1) = 1 + more x0 - (1 - x0), so dx(1)/dx0 = more + 1."""
    adjoint = hs.Replay() if way is reverse_mode else hs.ForwardSensitivities()
    final = lambda x0: hs.solve(Lift(jnp.array(0.7)), x0, t1=1.0, max_events=4, adjoint=adjoint).final
    found = (jax.grad if way is reverse_mode else jax.jacfwd)(final)(jnp.array(0.5))
    assert_close(found, 1.7, 1e-7)


def check_system(name):
    def check(way):
        differentiate, p = way(name)
        found = differentiate(p, 1e-9)
        assert_rows_close(found[1] if way is reverse_mode else found, truth(name)[1])

    return check


CASES = [
    (event_time_held_fixed, check_system("thermostat")),
    (guards_parameters_forgotten, check_system("thermostat")),
    (guards_time_derivative_forgotten, check_system("buck-converter")),
    (flow_after_in_the_old_mode, check_system("thermostat")),
    (jump_of_the_running_cost_forgotten, check_system("thermostat")),
    (resets_time_derivative_forgotten, check_lift),
]


@pytest.mark.parametrize("way", [reverse_mode, forward_mode])
@pytest.mark.parametrize("mistake, check", CASES, ids=[mistake.__name__ for mistake, _ in CASES])
def test_a_mistake_is_seen(monkeypatch, mistake, check, way):
    name, wrong = mistake({name: getattr(rules, name) for name in ("jump", "fallen_guard", "flows_at")})
    monkeypatch.setattr(rules, name, wrong)
    jax.clear_caches()  # what was traced before knows nothing of the mistake
    try:
        with pytest.raises(AssertionError, match="differs by"):
            check(way)
    finally:
        jax.clear_caches()


@pytest.mark.parametrize("way", [reverse_mode, forward_mode])
def test_a_reset_that_depends_on_time(way):
    check_lift(way)
