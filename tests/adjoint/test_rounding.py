"""A tangent that is rounding at first is not followed to its last digit: no step would be short enough."""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np

import hybridsens as hs


class Hopper(hs.AbstractScene):
    """Two bodies on a spring that begins without a stretch: both fall, and the stiffness acts by rounding alone until
    the damper has parted them a little."""

    stiffness: jax.Array
    damping: jax.Array

    def mass_matrix(self, q):
        return jnp.diag(jnp.array([2.0, 0.3]))

    def force(self, t, q, v):
        leg = self.stiffness * (0.5 - (q[0] - q[1])) + self.damping * jnp.tanh(v[0] - 0.3 * v[1])
        return jnp.stack([leg - 19.62, -leg - 2.943])

    def gap(self, t, q):
        return q[1:]

    def restitution(self):
        return jnp.array([0.0])


@eqx.filter_jit
def place(scene, adjoint):
    start = hs.State(jnp.array([0.8, 0.3]), jnp.zeros(2))
    settings = dict(rtol=1e-12, atol=1e-12, max_steps=1024, max_events=4, adjoint=adjoint)
    return hs.simulate(scene, start, t1=0.1, **settings).final.q[0]


def test_a_spring_that_is_not_stretched_yet_has_a_derivative():
    """By both at once, which share their steps, and by reverse mode; it was nan, after ten thousands of steps."""
    scene = Hopper(jnp.array(400.0), jnp.array(5.0))
    forward = jax.jacfwd(place)(scene, hs.ForwardSensitivities())
    reverse = jax.grad(place)(scene, hs.Replay())
    for found, expected in zip(*map(jax.tree.leaves, (forward, reverse)), strict=True):
        np.testing.assert_allclose(found, expected, rtol=1e-9)
