"""Kinematics of the gaps at one instant: Phi, its rate, its gradient, its acceleration."""

from typing import NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from .few import SomeContacts
from .mass import solve_mass
from .scene import AbstractScene


class Instant(NamedTuple):
    """A time, and the configuration and velocity there."""

    t: Float[Array, ""]
    q: Float[Array, "dof"]
    v: Float[Array, "dof"]


def gap_and_rate(scene: AbstractScene, t, q, v) -> tuple[Float[Array, "contact"], Float[Array, "contact"]]:
    """Gaps Phi(t, q) [m] and their rates Phi' = Phi_t + G^T v [m/s]."""
    return jax.jvp(scene.gap, (t, q), (jnp.ones_like(t), v))


def gap_rate_and_bias(scene: AbstractScene, t, q, v) -> tuple[Float[Array, "contact"], Float[Array, "contact"]]:
    """Gap rates [m/s] and gamma = Phi_tt + 2 Phi_tq v + v^T Phi_qq v [m/s^2], so that Phi'' = G^T v' + gamma."""
    return jax.jvp(lambda t, q: gap_and_rate(scene, t, q, v)[1], (t, q), (jnp.ones_like(t), v))


def contact_jacobian(scene: AbstractScene, t, q) -> Float[Array, "contact dof"]:
    """dPhi/dq, the paper's G transposed: by rows where there are far more coordinates than contacts."""
    contacts = jax.eval_shape(scene.gap, t, q).shape[0]
    derivative = jax.jacrev if 4 * contacts <= q.shape[0] and isinstance(scene, SomeContacts) else jax.jacfwd
    return derivative(scene.gap, argnums=1)(t, q)


class ContactGeometry(eqx.Module):
    """Everything about the contacts that the laws of motion and of impact need, at one (t, q, v)."""

    jacobian: Float[Array, "contact dof"]
    """dPhi/dq = G^T."""
    mobility: Float[Array, "dof contact"]
    """M^-1 G: what a unit impulse at each contact does to the velocities."""
    delassus_matrix: Float[Array, "contact contact"]
    """W = G^T M^-1 G."""


def contact_geometry(scene: AbstractScene, t, q) -> ContactGeometry:
    """G^T, M^-1 G and W = G^T M^-1 G at (t, q)."""
    jacobian = contact_jacobian(scene, t, q)
    mobility = solve_mass(scene.mass_matrix(q), jacobian.T)
    return ContactGeometry(jacobian, mobility, jacobian @ mobility)
