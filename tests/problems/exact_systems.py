"""The ready-made systems in 30 digits: closed forms between events, events by bracketed roots, costs by quadrature.

Nothing here knows of the package but the names of its parameters. States are tuples in the order of `x`'s leaves.
"""

from typing import NamedTuple

import mpmath
import numpy as np
from mpmath import mp

mp.dps = 30
NODES = mpmath.calculus.quadrature.GaussLegendre(mp).calc_nodes(4, mp.prec)
SCAN = 400
"""Places of the horizon at which guards are looked at, where nothing is known of the events."""
NEAR = mp.mpf(10) ** -9
"""How near the events of a motion lie that differs by much less."""


class Motion(NamedTuple):
    times: list
    final: tuple
    cost: mp.mpf

    def numbers(self) -> list:
        """Event times, final state and cost in one list."""
        return [*self.times, *self.final, self.cost]


def integral(f, a, b):
    """Gauss and Legendre's, with 24 nodes: the integrands here are smooth."""
    middle, half = (a + b) / 2, (b - a) / 2
    return half * mp.fsum(weight * f(middle + half * node) for node, weight in NODES)


def follow(system, p, t1, guide: Motion | None = None) -> Motion:
    """The motion of a system with parameters p. With `guide`, that of nearly the same parameters, its events are looked
    for beside those of the guide."""
    x, mode = system.start(p)
    t, times, cost = mp.mpf(0), [], mp.mpf(0)
    while True:
        guard = lambda s, t=t, x=x, mode=mode: system.guards(p, mode, t + s, system.advance(p, mode, x, s))
        known = guide and guide.times[len(times) : len(times) + 1]
        bracket = _scan(guard, t1 - t, t1) if guide is None else [(s - t - NEAR, s - t + NEAR) for s in known]
        event, s = _first_root(guard, bracket[0]) if bracket else (None, t1 - t)
        cost += integral(lambda s, t=t, x=x, mode=mode: system.rate(p, mode, system.advance(p, mode, x, s)), 0, s)
        t, x = t + s, system.advance(p, mode, x, s)
        if event is None:
            return Motion(times, x, cost)
        times.append(t)
        x, mode = system.transition(p, event, x, mode)


def _scan(guard, length, t1) -> list:
    """The first bracket in which a guard falls from above 0; none, or one."""
    before, step = guard(mp.mpf(0)), mp.mpf(t1) / SCAN
    places = [k * step for k in range(1, int(length / step) + 1)] + [length]
    last = mp.mpf(0)
    for place in places:
        now = guard(place)
        if any(old > NEAR and new <= 0 for old, new in zip(before, now, strict=True)):
            return [(last, place)]
        before, last = now, place
    return []


def _first_root(guard, bracket):
    """Which guard falls first in a bracket, and when."""
    low, high = guard(bracket[0]), guard(bracket[1])
    falling = [k for k, (a, b) in enumerate(zip(low, high, strict=True)) if a > 0 >= b]
    root = lambda k: mp.findroot(lambda s: guard(s)[k], bracket, solver="anderson", tol=mp.mpf(10) ** -50)
    s, event = min((root(k), k) for k in falling)
    return event, s


def two_decays(fast, slow, gain, x0, y0, s):
    """x' = -fast x, y' = gain x - slow y."""
    share = gain * x0 / (slow - fast)
    return x0 * mp.exp(-fast * s), share * mp.exp(-fast * s) + (y0 - share) * mp.exp(-slow * s)


def swing(a, w2, x0, v0, s):
    """x'' + 2 a x' + w2 x = 0, below its critical damping: x and x'."""
    w = mp.sqrt(w2 - a * a)
    b = (v0 + a * x0) / w
    decay, c, d = mp.exp(-a * s), mp.cos(w * s), mp.sin(w * s)
    x = decay * (x0 * c + b * d)
    return x, -a * x + decay * w * (b * c - x0 * d)


class Thermostat:
    def start(p):
        return (p.start,), False

    def advance(p, on, x, s):
        end = p.outside + (p.heating / p.rate if on else 0)
        return (end + (x[0] - end) * mp.exp(-p.rate * s),)

    def guards(p, on, t, x):
        return [p.high - x[0] if on else x[0] - p.low]

    def transition(p, event, x, on):
        return x, not on

    def rate(p, on, x):
        return p.heating if on else mp.mpf(0)


class Neurons:
    def start(p):
        return (mp.mpf(0),) * (2 * len(p.drive)), None

    def advance(p, mode, x, s):
        n, share = len(p.drive), p.synapse_time / (p.synapse_time - p.membrane_time)
        slow, fast = mp.exp(-s / p.membrane_time), mp.exp(-s / p.synapse_time)
        i, v = x[:n], x[n:]
        v = [d + share * c * fast + (u - d - share * c) * slow for d, c, u in zip(p.drive, i, v, strict=True)]
        return (*(c * fast for c in i), *v)

    def guards(p, mode, t, x):
        return [*(p.threshold - v for v in x[len(p.drive) :]), *(at - t for at in p.input_times)]

    def transition(p, event, x, mode):
        n = len(p.drive)
        kicks = np.concatenate([p.weights, p.input_weights], axis=1)[:, event]
        v = [mp.mpf(0) if k == event else v for k, v in enumerate(x[n:])]
        return (*(c + kick for c, kick in zip(x[:n], kicks, strict=True)), *v), mode

    def rate(p, mode, x):
        return mp.fsum(v * v for v in x[len(p.drive) :])


class BuckConverter:
    def start(p):
        return (mp.mpf(0), p.voltage), (0, 0)

    def advance(p, mode, x, s):
        (carrier, _), (i, v), rc = mode, x, p.load * p.capacitance
        if carrier == 2:
            return mp.mpf(0), v * mp.exp(-s / rc)
        end = p.source if carrier == 0 else mp.mpf(0)
        u, du = swing(1 / (2 * rc), 1 / (p.inductance * p.capacitance), v - end, (i - v / p.load) / p.capacitance, s)
        return p.capacitance * du + (end + u) / p.load, end + u

    def guards(p, mode, t, x):
        carrier, cycle = mode
        ramp = t / p.period - cycle
        above = p.duty + p.gain * (p.reference - x[1]) - ramp
        return [above if carrier == 0 else mp.mpf(1), x[0] if carrier == 1 else mp.mpf(1), 1 - ramp]

    def transition(p, event, x, mode):
        return (mp.mpf(0) if event == 1 else x[0], x[1]), ((1, 2, 0)[event], mode[1] + (event == 2))

    def rate(p, mode, x):
        return p.source * x[0] if mode[0] == 0 else mp.mpf(0)


class Dosing:
    def start(p):
        return (p.before, mp.mpf(0)), None

    def advance(p, mode, x, s):
        gut, blood = two_decays(p.absorption, p.elimination, p.absorption, x[1], x[0], s)
        return blood, gut

    def guards(p, mode, t, x):
        return [at - t for at in p.times]

    def transition(p, event, x, mode):
        return (x[0], x[1] + p.doses[event]), mode

    def rate(p, mode, x):
        return (x[0] - p.target) ** 2


class StickSlip:
    def start(p):
        return (p.belt, p.start), 0

    def advance(p, mode, x, s):
        v, place = x
        if mode == 0:
            return p.belt, place + p.belt * s
        middle = -mode * p.sliding / p.stiffness
        out, speed = swing(p.damping / (2 * p.mass), p.stiffness / p.mass, place - middle, v, s)
        return speed, middle + out

    def guards(p, mode, t, x):
        pull = p.stiffness * x[1] + p.damping * p.belt
        return [p.holding - pull, p.holding + pull] if mode == 0 else [mode * (x[0] - p.belt), mp.mpf(1)]

    def transition(p, event, x, mode):
        pull = p.stiffness * x[1] + p.damping * p.belt
        loose = -1 if event == 0 else 1
        return (p.belt, x[1]), loose if mode == 0 else 0 if abs(pull) < p.holding else -int(mp.sign(pull))

    def rate(p, mode, x):
        return p.belt * (p.stiffness * x[1] + p.damping * p.belt if mode == 0 else -mode * p.sliding)


class TwoTanks:
    def start(p):
        return (p.lower, p.upper), (True, False)

    def advance(p, mode, x, s):
        pump, spills = mode
        end = x[1] if spills else p.inflow / p.drain_upper if pump else mp.mpf(0)
        rest = p.drain_upper * end / p.drain_lower
        upper, lower = two_decays(p.drain_upper, p.drain_lower, p.drain_upper, x[1] - end, x[0] - rest, s)
        return rest + lower, end + upper

    def guards(p, mode, t, x):
        switches = p.high - x[0] if mode[0] else x[0] - p.low
        return [switches, mp.mpf(1) if mode[1] else p.rim - x[1]]

    def transition(p, event, x, mode):
        return (x[0], x[1] if event == 0 else p.rim), (mode[0] != (event == 0), event == 1)

    def rate(p, mode, x):
        return p.inflow - p.drain_upper * x[1] if mode[1] else mp.mpf(0)


class RimlessWheel:
    """Its speed is known from its energy at every angle; times are integrals over the angle."""

    def follow(p, t1):
        first, last = p.slope - p.half, p.slope + p.half
        speed = lambda rate, a: mp.sqrt(rate**2 + 2 * p.gravity / p.length * (mp.cos(first) - mp.cos(a)))
        rate, t, times, cost = p.rate, mp.mpf(0), [], mp.mpf(0)
        lasts = lambda rate, end: integral(lambda a: 1 / speed(rate, a), first, end)
        while t + lasts(rate, last) < t1:
            t += lasts(rate, last)
            times.append(t)
            cost += integral(lambda a, rate=rate: speed(rate, a), first, last)
            rate = mp.cos(2 * p.half) * speed(rate, last)
        end = mp.findroot(lambda a: t + lasts(rate, a) - t1, (first, last), solver="anderson", tol=mp.mpf(10) ** -50)
        cost += integral(lambda a: speed(rate, a), first, end)
        return Motion(times, (end, speed(rate, end)), cost)
