"""Scenes with switches of their own, as a user would write them, and their motions in 30 digits."""

from typing import Any

import jax.numpy as jnp
from jax import Array
from mpmath import mp

import hybridsens as hs

mp.dps = 30


class Cart(hs.AbstractSwitchedScene):
    """A cart between two bumpers; a motor pushes it to the right until `far`, to the left until `near`."""

    push: Array
    near: Array
    far: Array
    width: Array
    e: Array

    def mass_matrix(self, q):
        return jnp.eye(1)

    def force(self, t, q, v, mode):
        return jnp.where(mode, self.push, -self.push)[None]

    def gap(self, t, q):
        return jnp.stack([q[0], self.width - q[0]])

    def restitution(self):
        return jnp.stack([self.e, self.e])

    def switches(self, t, q, v, mode):
        return jnp.where(mode, self.far - q[0], q[0] - self.near)[None]

    def switch(self, event, t, q, v, mode):
        return v, ~mode


class Shuttle(Cart):
    """A cart whose motor always pushes it the way it goes: an impact on a bumper throws the switch at once."""

    def switches(self, t, q, v, mode):
        return jnp.where(mode, v[0], -v[0])[None]


class Relay(hs.AbstractSwitchedScene):
    """A mass without contacts, drawn to q = 0 by a force of constant size, switched where q + k v passes +-h."""

    push: Array
    k: Array
    h: Array

    def mass_matrix(self, q):
        return jnp.eye(1)

    def force(self, t, q, v, mode):
        return jnp.where(mode == 1, self.push, -self.push)[None]

    def gap(self, t, q):
        return jnp.zeros(0, q.dtype)

    def restitution(self):
        return jnp.zeros(0)

    def switches(self, t, q, v, mode):
        signal = q[0] + self.k * v[0]
        return jnp.where(mode == 1, self.h - signal, signal + self.h)[None]

    def switch(self, event, t, q, v, mode):
        return v, 1 - mode


class Hopper(hs.AbstractSwitchedScene):
    """A ball that lies on the floor. At `times` it is kicked down with speed `kick`, a thrust begins, and ends."""

    g: Array
    thrust: Array
    kick: Array
    e: Array
    times: Array

    def mass_matrix(self, q):
        return jnp.eye(1)

    def force(self, t, q, v, mode):
        return (jnp.where(mode["thrust"], self.thrust, 0) - self.g)[None]

    def gap(self, t, q):
        return q

    def restitution(self):
        return self.e[None]

    def switches(self, t, q, v, mode):
        return self.times - t

    def switch(self, event, t, q, v, mode):
        thrust = jnp.where(event == 0, mode["thrust"], event == 1)
        return jnp.where(event == 0, v - self.kick, v), {"thrust": thrust, "count": mode["count"] + 1}


class Latch(hs.AbstractSwitchedScene):
    """A mass on a spring drops on a stop at q = 0; where it comes back up to `catch`, a latch holds it."""

    stiffness: Array
    catch: Array
    e: Array

    def mass_matrix(self, q):
        return jnp.eye(1)

    def force(self, t, q, v, mode):
        return jnp.where(mode, 0, -self.stiffness * q)

    def gap(self, t, q):
        return q

    def restitution(self):
        return self.e[None]

    def switches(self, t, q, v, mode):
        return jnp.where(mode, 1.0, self.catch - q[0])[None]

    def switch(self, event, t, q, v, mode):
        return jnp.zeros_like(v), jnp.array(True)


def cart_rates(p, mode):
    """Guards of a cart as (constant, by q, by v), contacts first."""
    _, near, far, width, _ = p
    return [(0, 1, 0), (width, -1, 0), (far, -1, 0) if mode else (-near, 1, 0)]


def shuttle_rates(p, mode):
    """The same of a shuttle."""
    return [(0, 1, 0), (p[3], -1, 0), (0, 0, 1 if mode else -1)]


def relay_rates(p, mode):
    """The same of a relay."""
    _, k, h = p
    return [(h, -1, -k) if mode else (h, 1, k)]


def constant_force(guards_of, contacts: int, p, q, v, mode, t1) -> tuple[list[tuple], list]:
    """Events (time, guard, mode after), then the final q and v and the integral of q^2 and of the push while mode is
    true, of a motion under +-push: roots of quadratics. A bumper sends it back with p[-1] of its speed."""
    t, events, cost = mp.mpf(0), [], mp.mpf(0)
    while True:
        a = p[0] if mode else -p[0]
        falls = [_fall(c0 + cq * q + cv * v, cq * v + cv * a, cq * a) for c0, cq, cv in guards_of(p, mode)]
        s = min([*falls, t1 - t])
        cost += _integral_of_square(q, v, a, s) + (p[0] * s if mode else 0)
        q, v = q + v * s + a * s * s / 2, v + a * s
        if s == t1 - t:
            return events, [q, v, cost]
        t, event = t + s, falls.index(s)
        v, mode = (-p[-1] * v, mode) if event < contacts else (v, not mode)
        events.append((t, event, mode))


def _fall(value, rate, bend):
    """When value + rate s + bend s^2 / 2 falls through 0: at once where it is below."""
    if value < -(mp.mpf(10) ** -20):
        return mp.mpf(0)
    if bend == 0:
        return -value / rate if rate < 0 else mp.inf
    under = rate * rate - 2 * bend * value
    if under < 0:
        return mp.inf
    s = (-rate - mp.sqrt(under)) / bend  # of both roots the one at which it falls
    return s if s > mp.mpf(10) ** -20 else mp.inf


def _integral_of_square(q, v, a, s):
    terms: list[Any] = [q * q, 2 * q * v, v * v + q * a, v * a, a * a / 4]
    return mp.fsum(term * s ** (k + 1) / (k + 1) for k, term in enumerate(terms))


def latch_numbers(stiffness, catch, e, q0):
    """Times of the impact and of the catch, and the speed just before it."""
    w = mp.sqrt(stiffness)
    down, up = mp.pi / (2 * w), mp.asin(catch / (e * q0)) / w
    return [down, down + up, w * mp.sqrt((e * q0) ** 2 - catch**2)]
