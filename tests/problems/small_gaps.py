"""Small gaps: a body in a slot of width 1e-9, a bead that hits a tip of small radius, a thin spike under a flight."""

import equinox as eqx
import jax
import jax.numpy as jnp

import hybridsens as hs

CLEARANCE = 1e-9


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


@eqx.filter_jit
def strike(radius, offset):
    """Velocity after striking the tip `offset` radii beside its middle, and its slope by the offset."""

    def final(offset):
        state = hs.State(jnp.stack([-jnp.ones_like(radius), offset * radius]), jnp.array([1.0, 0.0]))
        motion = hs.simulate(Tip(radius), state, t1=2.0, rtol=1e-10, atol=1e-14, throw=False)
        return motion.final.v, motion

    slope, motion = jax.jacrev(final, has_aux=True)(offset)
    return motion, slope


@eqx.filter_jit
def fly(width, max_step=None):
    """A flight over the spike, by steps no longer than `max_step` if there is one."""
    state = hs.State(jnp.zeros(1), jnp.ones(1))
    return hs.simulate(Spike(width), state, t1=1.0, max_step=max_step, throw=False)
