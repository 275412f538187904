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


class Shaken(hs.AbstractScene):
    """A free mass under a sin 40 t."""

    amplitude: jax.Array

    def mass_matrix(self, q):
        return jnp.eye(1)

    def force(self, t, q, v):
        return self.amplitude * jnp.sin(40.0 * t)[None]

    def gap(self, t, q):
        return q + 1e3

    def restitution(self):
        return jnp.array([0.5])


def test_a_small_parameter_of_a_large_effect_is_resolved_through_many_steps():
    """dq/da = T / 40 - sin(40 T) / 1600, however small a is: however many steps are spent, no error of it is rounding.

    The motion is trivial, so that none of these steps is one of its own."""
    start = hs.State(jnp.zeros(1), jnp.zeros(1))
    shaken = lambda a, adjoint: hs.simulate(Shaken(a), start, t1=30.0, adjoint=adjoint).final.q[0]
    reverse = jax.jit(jax.grad(lambda a: shaken(a, hs.Replay())))
    forward = jax.jit(jax.jacfwd(lambda a: shaken(a, hs.ForwardSensitivities())))
    found = [[float(slope(jnp.array(a))) for a in (0.0, 1e-14, 1e-11)] for slope in (reverse, forward)]
    np.testing.assert_allclose(found, np.full((2, 3), 30 / 40 - np.sin(1200.0) / 1600), rtol=1e-4)
