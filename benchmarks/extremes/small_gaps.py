"""Fast small gaps: rattling in a clearance of 1e-9, a bead that hits a tip of radius 1e-6, a thin spike in a gap.

    python -m benchmarks.extremes.small_gaps
"""

import argparse

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np

import hybridsens as hs

from .report import Row, main_of, status_name

CLEARANCE = 1e-9
RADII = (1.0, 1e-2, 1e-4, 1e-6)
WIDTHS = (0.3, 0.1, 0.01, 1e-3, 1e-6, 1e-9)


class Slot(hs.AbstractScene):
    """A free body between two walls a clearance apart, at a distance `place` from the origin."""

    place: jax.Array

    def mass_matrix(self, q):
        return jnp.eye(1)

    def force(self, t, q, v):
        return jnp.zeros(1)

    def gap(self, t, q):
        return jnp.concatenate([q - self.place, CLEARANCE - (q - self.place)])

    def restitution(self):
        return jnp.ones(2)


class Tip(hs.AbstractScene):
    """A bead in the plane beside a disc of small radius at the origin."""

    radius: jax.Array

    def mass_matrix(self, q):
        return jnp.eye(2)

    def force(self, t, q, v):
        return jnp.zeros(2)

    def gap(self, t, q):
        return (jnp.sqrt(q @ q) - self.radius)[None]

    def restitution(self):
        return jnp.ones(1)


class Spike(hs.AbstractScene):
    """A bead that flies along q[0] under a ceiling at 1 with a spike of height 2 and a given width at q[0] = 0.6."""

    width: jax.Array

    def mass_matrix(self, q):
        return jnp.eye(1)

    def force(self, t, q, v):
        return jnp.zeros(1)

    def gap(self, t, q):
        return 1 - 2 * jnp.exp(-(((q - 0.6) / self.width) ** 2))

    def restitution(self):
        return jnp.ones(1)


@eqx.filter_jit
def rattle(place, speed):
    """q(1) - place of a body that starts in the middle, and its slope by the speed."""

    def final(speed):
        state = hs.State((place + CLEARANCE / 2)[None], speed[None])
        motion = hs.simulate(Slot(place), state, t1=1.0, max_events=2048, max_steps=16384, throw=False)
        return motion.final.q[0] - place, motion

    (value, motion), slope = jax.value_and_grad(final, has_aux=True)(speed)
    return value, slope, motion


def rattling() -> list[Row]:
    """A thousand impacts in one unit of time: q is a triangular wave in the distance travelled."""
    rows = []
    speed = 1000.25 * CLEARANCE
    for place in (0.0, 1.0):
        value, slope, motion = rattle(jnp.array(place), jnp.array(speed))
        travelled = CLEARANCE / 2 + speed
        crossings = int(travelled // CLEARANCE)
        expected = travelled - crossings * CLEARANCE
        expected, sign = (CLEARANCE - expected, -1.0) if crossings % 2 else (expected, 1.0)
        ends, wrong = status_name(motion), abs(int(motion.events.count) - crossings)
        error = abs(float(value) - expected) / CLEARANCE
        rows += [
            Row("rattling in 1e-9", "impacts missed or made up, walls at", place, wrong, ends),
            Row("rattling in 1e-9", "place, relative to the clearance", place, error, ends),
            Row("rattling in 1e-9", "slope by the speed", place, abs(float(slope) - sign), ends),
        ]
    return rows


@eqx.filter_jit
def strike(radius, offset):
    """Velocity after striking the tip `offset` radii beside its middle, and its slope by the offset."""

    def final(offset):
        state = hs.State(jnp.stack([-jnp.ones_like(radius), offset * radius]), jnp.array([1.0, 0.0]))
        motion = hs.simulate(Tip(radius), state, t1=2.0, rtol=1e-10, atol=1e-14, throw=False)
        return motion.final.v, motion

    slope, motion = jax.jacrev(final, has_aux=True)(offset)
    return motion, slope


def tips(offset=0.6) -> list[Row]:
    """Reflection at the normal (-cos a, sin a) with sin a = offset: v+ = (-cos 2a, sin 2a)."""
    rows = []
    expected = lambda b: jnp.stack([2 * b**2 - 1, 2 * b * jnp.sqrt(1 - b**2)])
    for radius in RADII:
        motion, slope = strike(jnp.array(radius / 2), jnp.array(offset))
        error = float(jnp.max(jnp.abs(motion.final.v - expected(offset))))
        error_slope = float(jnp.max(jnp.abs(slope - jax.jacfwd(expected)(offset))))
        rows.append(Row("tip of small radius", "velocity after", radius / 2, error, status_name(motion)))
        rows.append(Row("tip of small radius", "its slope by the offset", radius / 2, error_slope, status_name(motion)))
    return rows


@eqx.filter_jit
def fly(width, max_step=None):
    """A flight over the spike, by steps no longer than `max_step` if there is one."""
    state = hs.State(jnp.zeros(1), jnp.ones(1))
    return hs.simulate(Spike(width), state, t1=1.0, max_step=max_step, throw=False)


def spikes() -> list[Row]:
    """The bead must turn back where the spike reaches down to it: at q = 0.6 - width sqrt(ln 2)."""
    rows = []
    for width in WIDTHS:
        turn = 0.6 - width * np.sqrt(np.log(2))
        motion = fly(jnp.array(width))
        error = abs(float(motion.final.q[0]) - (2 * turn - 1))
        ends = status_name(motion) if int(motion.events.count) else "stepped over"
        rows.append(Row("thin spike", "place at the end", width, error, ends))
    return rows


def study() -> list[Row]:
    """All three."""
    return rattling() + tips() + spikes()


if __name__ == "__main__":
    main_of("small_gaps", lambda _: study(), argparse.ArgumentParser(description=__doc__))
