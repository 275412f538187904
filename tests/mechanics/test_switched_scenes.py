"""Scenes with contacts and switches of their own have the motions and gradients of their closed forms."""

from functools import cache

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from mpmath import mp

import hybridsens as hs
from hybridsens.mechanics.mode import EventKind
from tests.closeness import assert_close
from tests.problems.switched_scenes import (
    Cart,
    Hopper,
    Latch,
    Relay,
    Shuttle,
    cart_rates,
    constant_force,
    latch_numbers,
    relay_rates,
    shuttle_rates,
)

STEP = mp.mpf(10) ** -14
TIGHT = dict(rtol=1e-10, atol=1e-10)


def cost_rate(scene, t, q, v, mode):
    """q^2, and the push while the mode is true: a cost that jumps at a switch."""
    return q[0] ** 2 + jnp.where(mode, scene.push, 0)


REPORTED = 6
"""How many event times are looked at, of motions with at least so many."""


@cache
def moved(scene_class, method: str = "reverse"):
    """(parameters, q0, v0, t1) -> numbers of the motion, and the gradient of their weighted sum; compiled."""
    adjoint = hs.ForwardSensitivities() if method == "forward" else hs.Replay()

    def numbers(vector, mode):
        *p, q0, v0, t1 = vector
        made = hs.simulate(
            scene_class(*p), hs.State(q0[None], v0[None]), mode, t1=t1, running_cost=cost_rate, adjoint=adjoint,
            max_events=32, **TIGHT,
        )  # fmt: skip
        out = jnp.concatenate([made.events.time[:REPORTED], made.final.q, made.final.v, made.cost[None]])
        return out @ WEIGHTS, (out, made.events, made.scene_mode)

    derive = (jax.jacfwd if method == "forward" else jax.grad)(numbers, has_aux=True)
    return jax.jit(derive)


WEIGHTS = np.cos(1.0 + 2.0 * np.arange(REPORTED + 3))
"""Of event times, final q, v and cost: none of them could stand for another."""


def truth(rates, contacts, vector, mode):
    """Events, numbers and the gradient of their weighted sum in 30 digits (half of them in the gradient)."""
    at = [mp.mpf(float(entry)) for entry in vector]

    def follow(at):
        *p, q0, v0, t1 = at
        return constant_force(rates, contacts, p, q0, v0, mode, t1)

    def total(at):
        return mp.fsum(float(w) * n for w, n in zip(WEIGHTS, numbers(*follow(at)), strict=True))

    numbers = lambda events, rest: [*(time for time, *_ in events[:REPORTED]), *rest]
    shifted = lambda k, h: [entry + (h if i == k else 0) for i, entry in enumerate(at)]
    slopes = [(total(shifted(k, STEP)) - total(shifted(k, -STEP))) / (2 * STEP) for k in range(len(at))]
    events, rest = follow(at)
    return events, np.array(numbers(events, rest), float), np.array(slopes, float)


def assert_true(scene_class, rates, contacts, vector, mode, methods=("reverse",), within=1e-9):
    """Sequence, modes, numbers and gradients of a motion are the exact ones."""
    vector = jnp.asarray(vector)
    events, numbers, slopes = truth(rates, contacts, vector, bool(mode))
    for method in methods:
        gradient, (found, made, last) = moved(scene_class, method)(vector, mode)
        n = int(made.count)
        switched = np.asarray(made.kind[:n]) == EventKind.SWITCH
        guards = np.where(switched, np.asarray(made.contact[:n]) + contacts, made.contact[:n])
        assert guards.tolist() == [guard for _, guard, _ in events]
        assert [bool(m) for m in made.mode[:n]] == [m for *_, m in events] and bool(last) == events[-1][2]
        assert_close(found, numbers, within)
        assert_close(gradient, slopes, 10 * within)


CART = [2.0, 0.3, 0.7, 1.0, 0.8, 0.1, 1.0, 2.6]


@pytest.mark.slow
def test_a_motor_between_bumpers_has_the_closed_form():
    """Times, end, cost and all derivatives, by thresholds, push, restitution, bumper, start and horizon."""
    assert_true(Cart, cart_rates, 2, CART, True, ("reverse", "forward"))


@pytest.mark.slow
@pytest.mark.parametrize("apart", [3e-7, 1e-12])
def test_a_switch_just_before_an_impact_is_resolved(apart):
    """Threshold and bumper lie so near that both events come almost at once."""
    vector = [*CART[:2], 1.0 - apart, *CART[3:]]
    events, *_ = truth(cart_rates, 2, vector, True)
    assert [guard for _, guard, _ in events[:2]] == [2, 1]
    assert_true(Cart, cart_rates, 2, vector, True)


@pytest.mark.slow
def test_an_impact_that_throws_a_switch_does_both_at_one_instant():
    """The switch comes at the impact's time, and moves with it."""
    events, *_ = truth(shuttle_rates, 2, CART, True)
    assert all(a[0] == b[0] for a, b in zip(events[::2], events[1::2], strict=True))
    assert_true(Shuttle, shuttle_rates, 2, CART, True)


@pytest.mark.slow
def test_a_relay_without_contacts_has_the_closed_form():
    """A hysteresis on q + k v, whose rate needs the acceleration; modes may be numbers."""
    assert_true(Relay, relay_rates, 0, [1.5, 0.4, 0.1, 0.8, 0.0, 4.0], 0)


@cache
def hopped():
    def value(scene, t1):
        start, mode = hs.State([0.0], [0.0]), {"thrust": False, "count": 0}
        made = hs.simulate(scene, start, mode, t1=t1, max_events=16, **TIGHT)
        return made.final.q[0] + 0.3 * made.final.v[0], (made.final, made.events, made.scene_mode, made.mode)

    return eqx.filter_jit(lambda scene, t1: jax.grad(value, argnums=(0, 1), has_aux=True)(scene, t1))


@pytest.mark.slow
def test_a_kick_against_a_held_contact_is_an_impact_at_once():
    """A ball on the floor, kicked down at time T with speed w, leaves it with e w: all derivatives are known."""
    scene = Hopper(*map(jnp.asarray, (9.81, 30.0, 2.0, 0.6)), jnp.array([0.2, 1.0, 1.1]))
    (slope, by_t1), (final, events, mode, closed) = hopped()(scene, jnp.array(0.35))
    assert events.kind[:2].tolist() == [EventKind.SWITCH, EventKind.IMPACT] and int(events.count) == 2
    rise = lambda g, w, e, T, t1: e * w * (t1 - T) - g * (t1 - T) ** 2 / 2 + 0.3 * (e * w - g * (t1 - T))
    exact = jax.grad(rise, argnums=(0, 1, 2, 3, 4))(9.81, 2.0, 0.6, 0.2, 0.35)
    assert_close([slope.g, slope.kick, slope.e, slope.times[0], by_t1], np.array(exact), 1e-9)
    assert int(mode["count"]) == 1 and not closed[0] and np.isclose(float(events.impulse[1, 0]), 1.6 * 2.0)


@pytest.mark.slow
def test_a_switch_that_lifts_a_held_contact_lets_it_go():
    """Without restitution the kick changes nothing; the thrust lifts the ball at once, and its end lets it fly on."""
    scene = Hopper(*map(jnp.asarray, (9.81, 30.0, 2.0, 0.0)), jnp.array([0.2, 0.5, 0.6]))
    (slope, by_t1), (final, events, mode, closed) = hopped()(scene, jnp.array(0.8))
    kinds = [EventKind.SWITCH, EventKind.CAPTURE, EventKind.SWITCH, EventKind.SWITCH]
    assert events.kind[:4].tolist() == kinds and int(events.count) == 4 and events.contact[:4].tolist() == [0, 0, 1, 2]

    def flight(g, thrust, begin, end, t1):
        burn, glide = end - begin, t1 - end
        v = (thrust - g) * burn - g * glide
        return (thrust - g) * burn**2 / 2 + (thrust - g) * burn * glide - g * glide**2 / 2 + 0.3 * v

    exact = jax.grad(flight, argnums=(0, 1, 2, 3, 4))(9.81, 30.0, 0.5, 0.6, 0.8)
    assert_close([slope.g, slope.thrust, slope.times[1], slope.times[2], by_t1], np.array(exact), 1e-9)
    assert not closed[0] and slope.times[0] == 0


def test_a_latch_waits_for_its_side_and_holds():
    """A latch that the mass first passes the other way catches it on its return, and holds it there."""
    vector = np.array([40.0, 0.3, 0.7, 1.0])

    def numbers(vector):
        *p, q0 = vector
        made = hs.simulate(Latch(*p), hs.State(q0[None], [0.0]), False, t1=1.0, max_events=8, **TIGHT)
        out = jnp.append(made.events.time[:2], made.events.before.v[1])
        return out @ WEIGHTS[:3], (out, made)

    slopes, (found, made) = eqx.filter_jit(jax.grad(numbers, has_aux=True))(jnp.asarray(vector))
    assert int(made.events.count) == 2 and bool(made.scene_mode)
    assert_close(jnp.append(made.final.q, made.final.v), np.array([0.3, 0.0]), 1e-9)
    exact = lambda *at: mp.fsum(float(w) * n for w, n in zip(WEIGHTS[:3], latch_numbers(*at), strict=True))
    at = [mp.mpf(float(entry)) for entry in vector]
    assert_close(found, np.array(latch_numbers(*at), float), 1e-9)
    one = lambda k: tuple(int(i == k) for i in range(4))
    assert_close(slopes, np.array([mp.diff(exact, at, one(k)) for k in range(4)], float), 1e-8)


class Thrown(hs.AbstractSwitchedScene):
    """A ball thrown up, whose switch only records where it turns, in a mode of nothing."""

    event_names = ("apex",)

    def mass_matrix(self, q):
        return jnp.eye(1)

    def force(self, t, q, v, mode):
        return -jnp.ones(1)

    def gap(self, t, q):
        return q

    def restitution(self):
        return jnp.full(1, 0.5)

    def switches(self, t, q, v, mode):
        return v

    def switch(self, event, t, q, v, mode):
        return v, mode


def test_switches_are_numbered_by_themselves_also_without_a_mode():
    """And drawn by their names, where they are."""
    start = hs.State(jnp.array([0.1]), jnp.array([1.0]))
    motion = hs.simulate(Thrown(), start, t1=3.0, ts=jnp.linspace(0, 3, 9), max_events=8)
    assert motion.events.kind[:3].tolist() == [EventKind.SWITCH, EventKind.IMPACT, EventKind.SWITCH]
    assert motion.events.contact[:3].tolist() == [0, 0, 0] and motion.events.mode is None
    gaps, velocities, _ = hs.plot_trajectory(Thrown(), motion).axes
    for panel in (gaps, velocities):
        (drawn,) = panel.collections
        assert [line[0, 0] for line in drawn.get_segments()] == motion.events.time[jnp.array([0, 2])].tolist()
    assert "apex (2)" in [text.get_text() for text in gaps.get_legend().get_texts()]
