"""Three coordinates, four flat contacts, a constant force: channels, corners, rows of balls and plates on feet.

One compiled function serves them all, because all that makes them different is an array leaf.
"""

import functools
from typing import NamedTuple

import jax
import jax.numpy as jnp

import hybridsens as hs
from tests.problems.flat_contacts import FlatContacts, make

FAR = ([0.0, 0.0, 0.0], 1.0)
"""A contact that is never reached: normal and offset."""


class Motion(NamedTuple):
    """A motion and its derivatives."""

    trajectory: hs.Trajectory
    by_scene: FlatContacts
    """d final (q, v) / d scene, six rows."""
    by_state: hs.State
    """d final (q, v) / d initial state."""


def scene(contacts, e, force=(0.0, -10.0, 0.0), mass=(1.0, 1.0, 1.0)) -> FlatContacts:
    """A scene from up to four (normal, offset); what is missing is far away."""
    contacts = [*contacts, *[FAR] * (4 - len(contacts))]
    e = [*e, *[0.0] * (4 - len(e))]
    normals, offsets = zip(*contacts, strict=True)
    return make(mass, force, normals, offsets, e)


@functools.cache
def _compiled():
    def final(scene, state, t1):
        settings = dict(rtol=1e-10, atol=1e-10, max_events=64, max_steps=2000, throw=False)
        trajectory = hs.simulate(scene, state, t1=t1, **settings)
        return jnp.concatenate([trajectory.final.q, trajectory.final.v]), trajectory

    return jax.jit(jax.jacrev(final, argnums=(0, 1), has_aux=True))


def solve(scene: FlatContacts, q, v, t1) -> Motion:
    """The motion, which must be successful."""
    start = hs.State(jnp.array(q, float), jnp.array(v, float))
    (by_scene, by_state), trajectory = _compiled()(scene, start, jnp.asarray(t1, float))
    assert trajectory.status == hs.Status.successful, f"{hs.Status[trajectory.status]}\n{trajectory}"
    return Motion(trajectory, by_scene, by_state)
