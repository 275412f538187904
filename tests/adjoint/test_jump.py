"""The jump across one event against the explicit formulas for its saltation matrix and its adjoint."""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest

import hybridsens as hs
from hybridsens.adjoint.jump import Jump, flows_at, jump, pull_jump_back, push_jump_forward
from hybridsens.flat_system import AbstractFlatSystem, Decision
from hybridsens.forward.record import Event
from hybridsens.mechanics.decisions import initial_mode
from hybridsens.mechanics.system import MechanicalSystem
from hybridsens.observables import EventStates
from hybridsens.scenes import BouncingBall, CylinderSlide
from tests.closeness import assert_close


class Nonlinear(AbstractFlatSystem):
    """Flow, guard and reset that depend on everything: time, state, mode and two parameters."""

    p: jax.Array

    def flow(self, t, x, mode):
        a = jnp.where(mode, self.p[1], self.p[0])
        return jnp.stack([jnp.sin(a * x[1]) + t, x[0] * x[2] - a, jnp.cos(t * a) - x[1]])

    def guards(self, t, x, mode):
        return jnp.stack([x[0] * x[1] - self.p[0] * jnp.sin(t)])

    def decide(self, event, t, x, mode):
        return Decision(jnp.where(event < 0, mode, ~mode), jnp.array(0))  # the start leaves it

    def reset(self, decision, t, x):
        b = self.p[1]
        after = jnp.stack([x[0] + b * t, x[1] * x[2] + jnp.exp(-t), -b * x[2] + x[0] ** 2])
        return after, x[1] ** 2 * b + t


def event_of(system, t, before, mode):
    """The record of an event at (t, before)."""
    decision = system.decide(jnp.array(0), t, before, mode)
    after, emitted = system.reset(decision, t, before)
    return Event(EventStates(t, before, after, emitted), jnp.array(0), decision, mode)


SYSTEM = Nonlinear(jnp.array([0.7, 1.3]))
T = jnp.array(0.4)
X = jnp.stack([SYSTEM.p[0] * jnp.sin(T) / -0.8, -0.8, 0.5])
"""A state on the guard."""
EVENT = event_of(SYSTEM, T, X, jnp.array(False))


def saltation_matrix(system, event):
    """S, column by column."""
    still = jax.tree.map(jnp.zeros_like, eqx.filter(system, eqx.is_inexact_array))
    column = lambda dx: push_jump_forward(system, event, still, dx, 0.0).state
    return jax.vmap(column, out_axes=1)(jnp.eye(event.states.before.size))


def parts():
    """h', R, and every partial derivative that the formulas name; theta is the pair of parameters."""
    h = lambda t, x, p: Nonlinear(p).guards(t, x, EVENT.mode)[0]
    R = lambda t, x, p: Nonlinear(p).reset(EVENT.decision, t, x)[0]
    E = lambda t, x, p: Nonlinear(p).reset(EVENT.decision, t, x)[1]
    by = lambda f: jax.jacfwd(f, argnums=(0, 1, 2))(T, X, SYSTEM.p)
    minus, plus = SYSTEM.flow(T, X, EVENT.mode), SYSTEM.flow(T, EVENT.states.after, EVENT.decision.mode)
    return by(h), by(R), by(E), minus, plus


def test_forward_jump_is_the_saltation_formula():
    """dt = -(h_x dx + h_theta dtheta) / h' (T5); dx+ = R_x dx + R_theta dtheta + (R_x f- + R_t - f+) dt (T6)."""
    (h_t, h_x, h_p), (R_t, R_x, R_p), (E_t, E_x, E_p), minus, plus = parts()
    dx, dp = jnp.array([0.3, 1.1, -0.6]), jnp.array([0.9, -0.4])
    dt = -(h_x @ dx + h_p @ dp) / (h_t + h_x @ minus)
    at_guard = dx + minus * dt
    reported = EventStates(
        time=dt,
        before=at_guard,
        after=R_x @ at_guard + R_p @ dp + R_t * dt,
        emitted=E_x @ at_guard + E_p @ dp + E_t * dt,
    )
    expected = Jump(R_x @ dx + R_p @ dp + (R_x @ minus + R_t - plus) * dt, reported)
    found = push_jump_forward(SYSTEM, EVENT, Nonlinear(dp), dx, 0.0)
    for part, formula in zip(*map(jax.tree.leaves, (found, expected)), strict=True):
        assert_close(part, formula, 1e-13)


def test_reverse_jump_is_the_adjoint_jump_condition():
    """psi- and dJ/dtheta by (T8)-(T9), with what is reported of the event taken in as in (T10)."""
    (h_t, h_x, h_p), (R_t, R_x, R_p), _, minus, plus = parts()
    rng = np.random.default_rng(0)
    psi, before, after = (jnp.array(rng.normal(size=3)) for _ in range(3))
    time = jnp.array(0.7)
    # A change of the state after, at its moving time, reaches the cost through psi and through its own report.
    numerator = psi @ (R_x @ minus + R_t - plus) + after @ (R_x @ minus + R_t) + before @ minus + time
    mu = -numerator / (h_t + h_x @ minus)
    expected_x = R_x.T @ (psi + after) + before + h_x * mu
    expected_p = R_p.T @ (psi + after) + h_p * mu
    found, found_x, _ = pull_jump_back(SYSTEM, EVENT, Jump(psi, EventStates(time, before, after, jnp.array(0.0))))
    assert_close(found_x, expected_x, 1e-13)
    assert_close(found.p, expected_p, 1e-13)


def test_the_jump_moves_nothing():
    """In value it is the reset itself, at the recorded time."""
    found = jump(SYSTEM, EVENT, flows_at(SYSTEM, EVENT), X, 0.0)
    assert_close(found.state, EVENT.states.after, 1e-14)
    assert_close(found.reported.time, T, 1e-14)


@pytest.mark.slow
def test_saltation_of_a_ball():
    """S = [[-e, 0], [-(1 + e) g / v-, -e]], whose determinant is e^2."""
    g, e, v = 9.81, 0.8, -4.0
    system = MechanicalSystem(BouncingBall(restitution_coefficient=e), None, 1e-6, 1)
    before, t = jnp.array([0.0, v]), jnp.array(0.5)
    mode = initial_mode(system.scene, t, jnp.array([1.0]), jnp.array([v]), 1e-8)
    event = event_of(system, t, before, mode)
    S = saltation_matrix(system, event)
    assert_close(S, [[-e, 0.0], [-(1 + e) * g / v, -e]], 1e-14)
    assert_close(jnp.linalg.det(S), e**2, 1e-14)


@pytest.mark.slow
def test_the_adjoint_is_continuous_at_a_release():
    """Where a multiplier falls through zero both flows are equal, so (T8) gives mu = 0 and psi- = psi+."""
    scene = CylinderSlide()
    system = MechanicalSystem(scene, None, 1e-6, 2)
    start = scene.initial_state()
    mode = initial_mode(scene, jnp.array(0.0), start.q, start.v, 1e-8)
    assert mode.active.tolist() == [True, False]
    cosine = 2 / 3 * jnp.cos(scene.angle)
    sine, speed = jnp.sqrt(1 - cosine**2), jnp.sqrt(9.81 * cosine)
    before = jnp.stack([sine, cosine, speed * cosine, -speed * sine])
    event = event_of(system, jnp.array(0.9), before, mode)
    assert event.decision.kind == hs.EventKind.RELEASE
    assert_close(*flows_at(system, event), 1e-14)
    assert_close(saltation_matrix(system, event), np.eye(4), 1e-13)
