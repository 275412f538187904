"""Hybrid systems at random, and their motions by SciPy: what is compared shares no code.

Three states, three modes; flows that are linear and damped by a cube, and driven; four guards that depend on time too;
two scheduled times; one time at which the flow jumps; affine transitions, by a table of modes. A motion by SciPy is
refused (`Doubtful`) where a guard comes nearer to zero than the differences below may move it.
"""

from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from scipy.integrate import solve_ivp
from scipy.optimize import brentq

import hybridsens as hs

N, MODES, GUARDS, SCHEDULED, T1, ROOM = 3, 3, 4, 2, 6.0, 24


class RandomSystem(hs.AbstractHybridSystem):
    """Every field has a row for each mode, or for each event. The mode brings what is discrete about the system."""

    known_discontinuities = True
    flow_matrix: jax.Array
    push: jax.Array
    drive: jax.Array
    frequency: jax.Array
    cubic: jax.Array
    slope: jax.Array
    level: jax.Array
    drift: jax.Array
    reset_matrix: jax.Array
    reset_shift: jax.Array
    reset_drift: jax.Array
    times: jax.Array
    kick_time: jax.Array
    kick: jax.Array

    def flow(self, t, x, mode):
        now = mode.now
        driven = self.push[now] + self.drive[now] * jnp.sin(self.frequency[now] * t)
        rate = self.flow_matrix[now] @ x + driven - self.cubic[now] * x**3
        return rate + jnp.where(t > self.kick_time, self.kick, 0)

    def guards(self, t, x, mode):
        values = self.slope[mode.now] @ x + self.level[mode.now] + self.drift[mode.now] * t
        return jnp.where(mode.watched[mode.now], values, 1.0)

    def transition(self, event, t, x, mode):
        after = self.reset_matrix[event] @ x + self.reset_shift[event] + self.reset_drift[event] * t
        return after, mode._replace(now=mode.table[event, mode.now])

    def scheduled_times(self, x, mode):
        return self.times

    def jump_times(self):
        return self.kick_time[None]


class Discrete(NamedTuple):
    """What is discrete."""

    now: Any
    """The mode."""
    watched: Any
    """Which guards there are in each mode."""
    table: Any
    """The mode after each event in each mode."""


def running_cost(system, t, x, mode):
    """Depends on the mode, and on the time."""
    return (x @ x) * (1 + 0.3 * mode.now) + 0.1 * t * x[0]


class Drawn(NamedTuple):
    """A system, where it starts, and what is asked of its motion, in NumPy."""

    fields: dict[str, np.ndarray]
    x0: np.ndarray
    ts: np.ndarray
    t1: np.ndarray
    discrete: Discrete


def draw(seed: int) -> Drawn:
    """The same for the same seed."""
    g = np.random.default_rng(seed)
    normal, uniform, events = (lambda *s: g.normal(size=s)), g.uniform, GUARDS + SCHEDULED
    fields = dict(
        flow_matrix=0.7 * normal(MODES, N, N) - 0.3 * np.eye(N), push=normal(MODES, N), drive=2 * normal(MODES, N),
        frequency=uniform(0.5, 4, MODES), cubic=uniform(0, 0.1, (MODES, N)), slope=normal(MODES, GUARDS, N),
        level=uniform(0.5, 2, (MODES, GUARDS)), drift=0.1 * normal(MODES, GUARDS),
        reset_matrix=0.25 * normal(events, N, N), reset_shift=0.3 * normal(events, N),
        reset_drift=0.05 * normal(events, N), times=uniform(0.2, T1 - 0.2, SCHEDULED),
        kick_time=np.array(uniform(0.2, T1 - 0.2)), kick=normal(N),
    )  # fmt: skip
    discrete = Discrete(np.array(0), uniform(size=(MODES, GUARDS)) < 0.7, g.integers(0, MODES, (events, MODES)))
    return Drawn(fields, 0.5 * normal(N), np.linspace(0.3, T1 - 0.15, 5), np.array(T1), discrete)


class Doubtful(Exception):
    """A small change might change what happens."""


class Followed(NamedTuple):
    """A motion by SciPy."""

    final: np.ndarray
    cost: float
    samples: np.ndarray
    times: list[float]
    sequence: list[int]


class _By(NamedTuple):
    """A system in NumPy."""

    p: dict[str, np.ndarray]
    discrete: Discrete

    def rate(self, t, y, mode, kicked):
        p, x = self.p, y[:N]
        driven = p["push"][mode] + p["drive"][mode] * np.sin(p["frequency"][mode] * t)
        rate = p["flow_matrix"][mode] @ x + driven - p["cubic"][mode] * x**3 + (p["kick"] if kicked else 0)
        return np.append(rate, (x @ x) * (1 + 0.3 * mode) + 0.1 * t * x[0])

    def guards(self, t, x, mode):
        values = self.p["slope"][mode] @ x + self.p["level"][mode] + self.p["drift"][mode] * t
        return np.where(self.discrete.watched[mode], values, 1.0)

    def reset(self, event, t, x):
        return self.p["reset_matrix"][event] @ x + self.p["reset_shift"][event] + self.p["reset_drift"][event] * t


def follow(drawn: Drawn, margin: float = 1e-4) -> Followed:
    """A motion and its samples. Raises: `Doubtful`."""
    fields, x0, ts, t1, discrete = drawn
    by, t, y, mode, armed = _By(fields, discrete), 0.0, np.append(x0, 0.0), int(discrete.now), None
    known = sorted([(at, GUARDS + k) for k, at in enumerate(fields["times"])] + [(float(fields["kick_time"]), -1)])
    samples, times, sequence = np.full((len(ts), N), np.nan), [], []
    if min(at for at, _ in known) < 0 or max(at for at, _ in known) > t1:
        raise Doubtful
    while True:
        values = by.guards(t, y[:N], mode)
        _clear(values, margin)
        armed = values > 0 if armed is None else armed | (values > 0)
        stop, event = next(((at, k) for at, k in known if at > t), (t1, None))
        given = mode, t >= fields["kick_time"]
        path = solve_ivp(by.rate, (t, stop), y, "DOP853", rtol=1e-12, atol=1e-13, args=given, dense_output=True)
        fall = _first_fall(by, path.sol, (t, stop), mode, armed, margin)
        end, event = fall or (stop, event)
        here = (ts >= t) & (ts <= end)
        if here.any():
            samples[here] = path.sol(ts[here])[:N].T
        t, y = end, path.sol(end) if fall else path.y[:, -1]
        if event is None:
            return Followed(y[:N], y[N], samples, times, sequence)
        if event == -1:
            continue
        y, mode, armed = _pass(by, event, t, y, mode, (times, sequence), margin)


def _clear(values, margin):
    if (np.abs(values) < margin).any():
        raise Doubtful


def _first_fall(by: _By, path, span, mode, armed, margin):
    """Time and number of the first guard that falls, if one does. One that is not armed must rise before."""
    fine = np.linspace(*span, max(50, int((span[1] - span[0]) / 0.002)))
    values = np.array([by.guards(t, x[:N], mode) for t, x in zip(fine, path(fine).T, strict=True)])
    falls = []
    for k in range(GUARDS):
        ready = armed[k] | np.logical_or.accumulate(values[:, k] > 0)
        places = np.flatnonzero(ready[:-1] & (values[:-1, k] > 0) & (values[1:, k] <= 0))
        if places.size:
            value = lambda t, k=k: by.guards(t, path(t)[:N], mode)[k]
            falls.append((brentq(value, *fine[places[0] : places[0] + 2], xtol=1e-15), k))
    falls.sort()
    end = falls[0][0] if falls else span[1]
    middle = values[1:-1][fine[1:-1] < end]
    around = values[:-2][: len(middle)], values[2:][: len(middle)]
    turns = (middle - around[0]) * (around[1] - middle) < 0
    if (turns & (np.abs(middle) < 5e-3)).any() or any(at - end < margin for at, _ in falls[1:]):
        raise Doubtful
    if falls and span[1] - end < margin:
        raise Doubtful
    return falls[0] if falls else None


def _pass(by: _By, event, t, y, mode, rows, margin):
    """State, mode and armed guards after an event and those that it sets off: each guard that it puts below zero."""
    before = by.guards(t, y[:N], mode)
    while True:
        rows[0].append(t)
        rows[1].append(event)
        y, mode = np.append(by.reset(event, t, y[:N]), y[N]), by.discrete.table[event, mode]
        after = by.guards(t, y[:N], mode)
        _clear(after, margin)
        could = before > 0
        could[event : event + 1] = True  # it was at zero, or below it
        fires = np.flatnonzero((after < 0) & could[:GUARDS])
        if fires.size > 1 or len(rows[0]) > ROOM:
            raise Doubtful
        if fires.size == 0:
            return y, mode, after > 0
        event, before = int(fires[0]), after
