"""Scenes whose motions are trivial (at rest, in free flight, at zero control), and closed forms of their costs.

A few costs of a dict of arrays serve all points, so that each is compiled once for a gradient method. Each has a closed
form beside it, in JAX as well: its derivatives are the truth.
"""

import jax
import jax.numpy as jnp
import jax.scipy.linalg
import numpy as np
from jax import Array

import hybridsens as hs

MAX_STEPS = 16384
SAMPLED = jnp.array([1.0, 7.3])
CENTRES = jnp.linspace(0.1, 9.9, 50)
"""Where the pulses of a control are,"""
WIDTH = 0.15
"""and how wide."""
NODES, WEIGHTS = (np.asarray(x) for x in np.polynomial.legendre.leggauss(40))


class Springs(hs.AbstractScene):
    """Two bodies on springs of their own: q'' = -k q - c q' - g + a cos(w t), with nothing to hit."""

    p: dict

    sustained_contact = False

    def mass_matrix(self, q):
        return jnp.eye(2)

    def force(self, t, q, v):
        p = self.p
        return -p["k"] * q - p["c"] * v - p["g"] + p["a"] * jnp.cos(p["w"] * t)

    def gap(self, t, q):
        return 1e3 + q[:1]

    def restitution(self):
        return jnp.ones(1)


class Ball(hs.AbstractScene):
    """A ball above a floor, driven by a sin(w t)."""

    p: dict

    sustained_contact = False

    def mass_matrix(self, q):
        return jnp.eye(1)

    def force(self, t, q, v):
        return (-self.p["g"] + self.p["a"] * jnp.sin(self.p["w"] * t))[None]

    def gap(self, t, q):
        return q - self.p["floor"]

    def restitution(self):
        return self.p["e"][None]


class Held(hs.AbstractScene):
    """A slack spring, driven by a cos(w t), beside a body that is pressed against a wall and stays there."""

    p: dict

    def mass_matrix(self, q):
        return jnp.eye(2)

    def force(self, t, q, v):
        p = self.p
        return jnp.stack([-p["k"] * q[0] + p["a"] * jnp.cos(p["w"] * t), -p["push"]])

    def gap(self, t, q):
        return q[1:] - self.p["wall"]

    def restitution(self):
        return jnp.zeros(1)


class Driven(hs.AbstractScene):
    """A body driven by a network of two layers of (t, q) and by pulses in time."""

    p: dict

    sustained_contact = False

    def mass_matrix(self, q):
        return jnp.eye(1)

    def force(self, t, q, v):
        hidden = jnp.tanh(self.p["first"] @ jnp.stack([t, q[0]]) + self.p["bias"])
        return (self.p["last"] @ hidden + self.p["pulses"] @ pulses(t))[None]

    def gap(self, t, q):
        return 1e3 + q

    def restitution(self):
        return jnp.ones(1)


def pulses(t):
    """Shapes of the pulses."""
    return jnp.exp(-(((t - CENTRES) / WIDTH) ** 2) / 2)


def settings(tolerance, adjoint) -> dict:
    """How every motion is run; one that ends early has nan for its cost."""
    return dict(rtol=tolerance, atol=tolerance, max_steps=MAX_STEPS, adjoint=adjoint, throw="nan", max_events=8)


def _q0(scene, t, q, v):
    return q[0]


def springs(p: dict, tolerance, adjoint, ts=None) -> Array:
    """J = by_q q(T) + by_v v(T) + by_integral int q_0 dt, and with samples J = by_q q of both times."""
    cost = None if ts is not None else _q0
    run = settings(tolerance, adjoint)
    motion = hs.simulate(Springs(p), hs.State(p["q"], p["v"]), t1=p["t1"], ts=ts, running_cost=cost, **run)
    if ts is not None:
        return jnp.sum(motion.q @ p["by_q"])
    return p["by_q"] @ motion.final.q + p["by_v"] @ motion.final.v + p["by_integral"] * motion.cost


def springs_sampled(p: dict, tolerance, adjoint) -> Array:
    """Costs of the states at two times, both inside of one step of a trivial motion."""
    return springs(p, tolerance, adjoint, ts=SAMPLED)


def ball(p: dict, tolerance, adjoint) -> Array:
    """J = by_q q(T) + by_v v(T) + by_integral int q dt + by_time sum of the impacts' times."""
    run = settings(tolerance, adjoint)
    motion = hs.simulate(Ball(p), hs.State(p["q"][None], p["v"][None]), t1=p["t1"], running_cost=_q0, **run)
    happened = jnp.arange(8) < motion.events.count
    times = jnp.sum(jnp.where(happened, motion.events.time, 0))
    return (
        p["by_q"] * motion.final.q[0] + p["by_v"] * motion.final.v[0] + p["by_integral"] * motion.cost
        + p["by_time"] * times
    )  # fmt: skip


def held(p: dict, tolerance, adjoint) -> Array:
    """J = by_q q(T) + by_integral int q_0 + q_1 dt, from a start that is on the wall wherever it stands."""
    start = hs.State(jnp.stack([p["q"], p["wall"]]), jnp.stack([p["v"], jnp.zeros(())]))
    both = lambda scene, t, q, v: q[0] + q[1]
    motion = hs.simulate(Held(p), start, t1=p["t1"], running_cost=both, **settings(tolerance, adjoint))
    return p["by_q"] @ motion.final.q + p["by_integral"] * motion.cost


def driven(p: dict, tolerance, adjoint) -> Array:
    """J = q(T)."""
    start = hs.State(p["q"][None], p["v"][None])
    return hs.simulate(Driven(p), start, t1=p["t1"], **settings(tolerance, adjoint)).final.q[0]


def _oscillator(k, c, g, a, w, q, v, t):
    """(q, v, integral of q) at t of q'' = -k q - c q' - g + a cos(w t), by an exponential of a matrix."""
    zero, one = jnp.zeros(()), jnp.ones(())
    rows = [
        [zero, one, zero, zero, zero, zero],  # q
        [-k, -c, -g, a, zero, zero],  # v
        [zero] * 6,  # 1
        [zero, zero, zero, zero, -w, zero],  # cos(w t)
        [zero, zero, zero, w, zero, zero],  # sin(w t)
        [one, zero, zero, zero, zero, zero],  # integral of q
    ]
    matrix = jnp.stack([jnp.stack(row) for row in rows])
    end = jax.scipy.linalg.expm(matrix * t, max_squarings=40) @ jnp.stack([q, v, one, one, zero, zero])
    return end[0], end[1], end[5]


def springs_truth(p: dict) -> Array:
    """Closed form of `springs`."""
    of_both = jax.vmap(_oscillator, in_axes=(0, 0, 0, 0, None, 0, 0, None))
    q, v, area = of_both(p["k"], p["c"], p["g"], p["a"], p["w"], p["q"], p["v"], p["t1"])
    return p["by_q"] @ q + p["by_v"] @ v + p["by_integral"] * area[0]


def springs_sampled_truth(p: dict) -> Array:
    """Closed form of `springs_sampled`."""
    at_end = p | {"by_v": jnp.zeros(2), "by_integral": jnp.zeros(())}
    return jnp.sum(jax.vmap(lambda t: springs_truth(at_end | {"t1": t}))(SAMPLED))


def ball_truth(p: dict) -> Array:
    """Closed form of `ball`, from impact to impact; up to three of them."""
    a, w, g = p["a"], p["w"], p["g"]

    def fly(t0, q, v, t):
        d, sin, cos = t - t0, jnp.sin(w * t0), jnp.cos(w * t0)
        area = q * d + v * d**2 / 2 - g * d**3 / 6 + a / w**3 * (jnp.cos(w * t) - cos)
        area += a / w**2 * sin * d + a / w * cos * d**2 / 2
        at = q + v * d - g * d**2 / 2 - a / w**2 * (jnp.sin(w * t) - sin) + a / w * cos * d
        return at, v - g * d - a / w * (jnp.cos(w * t) - cos), area

    t0, q, v, area, times = jnp.zeros(()), p["q"], p["v"], jnp.zeros(()), jnp.zeros(())
    for _ in range(3):
        t = t0 + (v + jnp.sqrt(v**2 + 2 * g * (q - p["floor"]))) / g
        for _ in range(8):  # Newton's method; its last step has the derivative of the root
            t = jax.lax.stop_gradient(t)
            at, speed, _ = fly(t0, q, v, t)
            t = t - (at - p["floor"]) / jax.lax.stop_gradient(speed)
        _, speed, flown = fly(t0, q, v, t)
        hit = t < p["t1"]
        before, after = (t0, q, v, area, times), (t, p["floor"], -p["e"] * speed, area + flown, times + t)
        t0, q, v, area, times = (jnp.where(hit, new, old) for new, old in zip(after, before, strict=True))
    q, v, flown = fly(t0, q, v, p["t1"])
    return p["by_q"] * q + p["by_v"] * v + p["by_integral"] * (area + flown) + p["by_time"] * times


def held_truth(p: dict) -> Array:
    """Closed form of `held`."""
    zero = jnp.zeros(())
    q, _, area = _oscillator(p["k"], zero, zero, p["a"], p["w"], p["q"], p["v"], p["t1"])
    return p["by_q"] @ jnp.stack([q, p["wall"]]) + p["by_integral"] * (area + p["wall"] * p["t1"])


def driven_truth(p: dict) -> Array:
    """Linear in what is zero: q + v T + int (T - t) force dt along the flight, by Gauss's rule on 400 pieces."""
    edges = p["t1"] * jnp.linspace(0, 1, 401)
    half = p["t1"] / 800
    t = (edges[:-1, None] + half * (1 + NODES)).ravel()
    force = jax.vmap(lambda t: Driven(p).force(t, (p["q"] + p["v"] * t)[None], None)[0])(t)
    return p["q"] + p["v"] * p["t1"] + half * jnp.sum((p["t1"] - t) * force * jnp.tile(WEIGHTS, 400))
