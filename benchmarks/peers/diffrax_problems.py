"""P1 to P4 for the chain of Diffrax solves, each specialised by hand to the modes that it goes through."""

import importlib.util
from collections.abc import Callable
from typing import NamedTuple

if importlib.util.find_spec("jax") is not None:
    import jax.numpy as jnp


class Problem(NamedTuple):
    horizon: float
    start: Callable  # (parameters, solve) -> time and state from which the scan sets out
    field: Callable  # (time, state, parameters) -> rate of the state
    guard: Callable  # the same arguments -> gap; an event where it falls through zero
    reset: Callable  # (state, parameters) -> state just after the event
    functionals: tuple[Callable, ...]  # (final state) -> value, in the order of references.json
    events_in_start: int = 0


def _bouncing_ball() -> Problem:
    def start(p, solve):
        return 0.0, jnp.array([p[0], p[1], 0.0])

    def field(t, state, p):
        q, v, _ = state
        return jnp.array([v, -p[2], q**2])

    def reset(state, p):
        return state.at[1].multiply(-p[3])

    return Problem(2.0, start, field, lambda t, state, p: state[0], reset, (lambda s: s[0], lambda s: s[2]))


def _elastic_stop() -> Problem:
    def field(t, state, p):
        omega, zeta, amplitude, forcing, _, _ = p
        q, v, _ = state
        return jnp.array([v, -(omega**2) * q - 2 * zeta * omega * v + amplitude * jnp.cos(forcing * t), q**2])

    def reset(state, p):
        return state.at[1].multiply(-p[5])

    def start(p, solve):
        return 0.0, jnp.zeros(3)

    return Problem(20.0, start, field, lambda t, state, p: p[4] - state[0], reset, (lambda s: s[2],))


def _cylinder() -> Problem:
    """Slides in the angle from the top until the contact force is gone, then flies and bounces: x, y, x', y'."""

    def start(p, solve):
        def slide(t, state, p):
            return jnp.array([state[1], p[1] / p[0] * jnp.sin(state[0])])

        def contact_force(t, state, p):
            return p[1] * jnp.cos(state[0]) - p[0] * state[1] ** 2

        t, (angle, rate) = solve(slide, contact_force, 0.0, jnp.array([p[2], 0.0]))
        sine, cosine = jnp.sin(angle), jnp.cos(angle)
        return t, p[0] * jnp.array([sine, cosine, cosine * rate, -sine * rate])

    def fly(t, state, p):
        return jnp.array([state[2], state[3], 0.0, -p[1]])

    def reset(state, p):
        return state.at[3].multiply(-p[3])

    return Problem(2.5, start, fly, lambda t, s, p: s[1] + p[0], reset, (lambda s: s[0], lambda s: s[1]), 1)


def _two_balls() -> Problem:
    """q1, q2, q1', q2'; the smaller of the two gaps is the guard, so that the earliest event wins within a step."""

    def gaps(state):
        return state[0], state[1] - state[0]

    def reset(state, p):
        m1, m2, e1, e2, _ = p
        q1, q2, v1, v2 = state
        impulse = (1 + e2) * (v1 - v2) * m1 * m2 / (m1 + m2)
        floor_gap, ball_gap = gaps(state)
        on_floor = jnp.array([q1, q2, -e1 * v1, v2])
        together = jnp.array([q1, q2, v1 - impulse / m1, v2 + impulse / m2])
        return jnp.where(floor_gap < ball_gap, on_floor, together)

    def start(p, solve):
        return 0.0, jnp.array([1.0, 1.3, 0.0, 0.0])

    def fall(t, state, p):
        return jnp.array([state[2], state[3], -p[4], -p[4]])

    return Problem(1.5, start, fall, lambda t, s, p: jnp.minimum(*gaps(s)), reset, (lambda s: s[1],))


PROBLEMS = {"P1": _bouncing_ball, "P2": _elastic_stop, "P2b": _elastic_stop, "P3": _cylinder, "P4": _two_balls}
