"""One coordinate, one contact, in one compiled function for each gradient method and tolerance."""

import equinox as eqx
import jax
import jax.numpy as jnp
from jax import Array

import hybridsens as hs


class OneContact(hs.AbstractScene):
    """q'' = load - stiffness q, gap offset + side q."""

    load: Array
    stiffness: Array
    side: Array
    offset: Array
    e: Array

    def mass_matrix(self, q):
        return jnp.eye(1, dtype=q.dtype)

    def force(self, t, q, v):
        return self.load - self.stiffness * q

    def gap(self, t, q):
        return self.offset + self.side * q

    def restitution(self):
        return self.e


def make(load=0.0, stiffness=0.0, side=1.0, offset=0.0, e=0.5, dtype=float) -> OneContact:
    """A scene of scalars."""
    return OneContact(*(jnp.array([value], dtype) for value in (load, stiffness, side, offset, e)))


def squared(scene, t, q, v):
    """Running cost q^2."""
    return q[0] ** 2


@eqx.filter_jit
def run(scene, q, v, t0, t1, tolerance=1e-10, atol=None, capture_speed=None, max_events=4096):
    """Cost int q^2 + q(t1), its gradient by (scene, q, v), and the trajectory."""

    def cost(inputs):
        scene, q, v = inputs
        trajectory = hs.simulate(
            scene, hs.State(q[None], v[None]), t0=t0, t1=t1, running_cost=squared, rtol=tolerance,
            atol=tolerance if atol is None else atol, capture_speed=capture_speed, max_events=max_events,
            max_steps=4 * max_events, throw=False,
        )  # fmt: skip
        return trajectory.cost + trajectory.final.q[0], trajectory

    (value, trajectory), gradient = eqx.filter_value_and_grad(cost, has_aux=True)((scene, q, v))
    return value, gradient, trajectory


def go(scene, q, v, t1, t0=0.0, **settings):
    """`run` from plain numbers."""
    return run(scene, *(jnp.array(number, scene.e.dtype) for number in (q, v, t0, t1)), **settings)


def bouncing_cost(height, weight, e):
    """int q^2 of a ball dropped on a floor at 0, until it rests: the geometric series of its flights."""
    fall, speed = jnp.sqrt(2 * height / weight), jnp.sqrt(2 * height * weight)
    first = height**2 * fall - height * weight * fall**3 / 3 + weight**2 * fall**5 / 20
    return first + (8 / 3 - 4 + 32 / 20) * speed**5 / weight**3 * e**5 / (1 - e**5)


def oscillator_cost(v, d, e, t1):
    """int q^2 + q(t1) for q'' = -q from (0, v) in closed form: v sin t to the stop at d, then d cos s - e u sin s."""
    t = jnp.arcsin(d / v)
    w = -e * v * jnp.cos(t)
    s = t1 - t
    first = v**2 * (t / 2 - jnp.sin(2 * t) / 4)
    then = d**2 * (s / 2 + jnp.sin(2 * s) / 4) + w**2 * (s / 2 - jnp.sin(2 * s) / 4) + d * w * jnp.sin(s) ** 2
    return first + then + d * jnp.cos(s) + w * jnp.sin(s)


def relative(found, expected) -> float:
    """Largest relative error of the entries."""
    found, expected = jnp.asarray(found), jnp.asarray(expected)
    return float(jnp.max(jnp.abs(found / expected - 1)))


oscillator_slopes = jax.grad(oscillator_cost, argnums=(0, 1, 2))
bouncing_slopes = jax.grad(bouncing_cost, argnums=(0, 1, 2))
