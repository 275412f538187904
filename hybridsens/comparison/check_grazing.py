"""Where a motion nearly grazes a contact: slow impacts and near misses.

An impact with closing speed w moves by 1/w of what moves its path, so the derivatives grow like 1/w. A contact missed
by a gap d, where the gap has the second rate a, would be struck by a path that is closer by more than d: the speed of
the impact of a path closer by 2 d, sqrt(2 a d), says how narrow that is.
"""

from typing import NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np

from ..mechanics.contact import gap_and_rate
from ..mechanics.mode import EventKind
from ..simulate import simulate
from .check_events import cascades
from .check_motions import Call

SLOW = 1e-2
"""A speed below this part of the fastest is that of a graze: the differences of the smallest width reach across it."""
SAMPLES = 1025
"""At how many times a motion is looked at."""
NOISE = 1e-6
"""A rate below this part of the fastest is taken for 0, as that of a held contact is."""


class Graze(NamedTuple):
    """One contact that is struck slowly or missed narrowly."""

    time: float
    contact: int
    speed: float
    """Closing speed over the fastest, or what stands for it at a miss."""
    event: int | None
    """Which event; None for a miss."""


def grazes(call: Call, settings) -> list[Graze]:
    """Slow impacts and near misses of a motion, in the order of time."""
    times, gaps, rates = _look(call, settings)
    count = int(call.events.count)
    speeds = np.asarray(call.events.closing_speed)[:count]
    fastest = max(np.max(np.abs(rates), initial=0), np.max(speeds, initial=0))
    if not fastest > 0:
        return []
    found = _slow_impacts(call, speeds / fastest) + _misses(call, times, gaps, rates / fastest, fastest)
    return sorted(found, key=lambda graze: graze.time)


def _slow_impacts(call: Call, speed) -> list[Graze]:
    """Impacts that are slow by themselves, and not by those before them in a cascade."""
    restitution = np.asarray(call.scene.restitution())
    joined = cascades(call.events, restitution)
    time, kind, contact = (np.asarray(getattr(call.events, name)) for name in ("time", "kind", "contact"))
    strikes = lambda k: kind[k] == EventKind.IMPACT or (kind[k] == EventKind.CAPTURE and restitution[contact[k]] == 0)
    slow = [k for k in range(speed.size) if strikes(k) and k not in joined and speed[k] < SLOW]
    return [Graze(float(time[k]), int(contact[k]), float(speed[k]), k) for k in slow]


def _misses(call: Call, times, gaps, rates, fastest) -> list[Graze]:
    """Least gaps between events, where a gap stops to close and opens again; `rates` over the fastest."""
    turns = np.argwhere((rates[:-1] < -NOISE) & (rates[1:] > NOISE))
    events = np.asarray(call.events.time)[: int(call.events.count)]
    found = []
    for k, contact in turns:
        if np.any((events >= times[k]) & (events <= times[k + 1])):
            continue
        least, bend = _least(times[k + 1] - times[k], gaps[k : k + 2, contact], fastest * rates[k : k + 2, contact])
        speed = float(np.sqrt(2 * bend * max(least, 0.0)) / fastest)
        if speed < SLOW:
            found.append(Graze(float(times[k]), int(contact), speed, None))
    return found


def _least(h, gap, rate) -> tuple[float, float]:
    """Least gap of the cubic through both ends of an interval, and the mean second rate there."""
    s = np.linspace(0, 1, 257)
    cubic = (
        gap[0] * (1 + 2 * s) * (1 - s) ** 2
        + gap[1] * s**2 * (3 - 2 * s)
        + h * (rate[0] * s * (1 - s) ** 2 - rate[1] * s**2 * (1 - s))
    )
    return float(np.min(cubic)), float((rate[1] - rate[0]) / h)


def _look(call: Call, settings):
    """Times, and the gaps and their rates there."""
    ts = jnp.linspace(call.t0, call.t1, SAMPLES).at[-1].set(call.t1)

    horizon = dict(t0=call.t0, t1=call.t1, jump_ts=call.jump_ts)

    def look(scene, state, ts):
        motion = simulate(scene, state, *call.mode, **horizon, ts=ts, throw=False, **settings)
        return jax.vmap(lambda t, q, v: gap_and_rate(scene, t, q, v))(ts, motion.q, motion.v)

    gaps, rates = eqx.filter_jit(look)(call.scene, call.state, ts)
    return np.asarray(ts), np.asarray(gaps), np.asarray(rates)
