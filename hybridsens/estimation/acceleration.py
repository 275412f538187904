"""Steps that bend with a curved valley of the loss, where straight ones are cut short again and again."""

import jax.numpy as jnp
from jax import lax
from jax.scipy.linalg import cho_solve
from jaxtyping import Array, Bool, Float

from ..adjoint.methods import Replay

_PROBE = 0.1
"""Curvature is probed at this part of the step."""
_LARGEST = 0.75
"""Steps that would bend more than this, relatively, stay straight: they reach beyond what a parabola says."""


def geodesic(
    problem, z: Float[Array, "unknown"], step: Float[Array, "unknown"], r: Float[Array, "residual"],
    jacobian: Float[Array, "residual unknown"], damping: Float[Array, ""], wanted: Bool[Array, ""],
) -> Float[Array, "unknown"]:  # fmt: skip
    """A damped Newton step with geodesic acceleration, `step` + a / 2, if `wanted` and worth it; else `step`.

        (J^T J + damping) a = -J^T r_vv,   r_vv = (2 / h) ((r(z + h step) - r(z)) / h - J step)

    r_vv is the second derivative of the residuals along the step, for one more motion without derivatives.
    Transtrum and Sethna, Improvements to the Levenberg-Marquardt algorithm for nonlinear least-squares minimization,
    arXiv:1201.5885 (2012), section 3. `r` and `jacobian` are those at z.
    """

    def correction():
        ahead, trial = problem.residuals(z + _PROBE * step, Replay())
        second = 2 / _PROBE * ((ahead - r) / _PROBE - jacobian @ step)
        damped = jnp.concatenate([jacobian, jnp.sqrt(damping) * jnp.eye(z.size, dtype=z.dtype)])
        a = -cho_solve((jnp.linalg.qr(damped, mode="r"), False), jacobian.T @ second)
        small = jnp.linalg.norm(a) <= _LARGEST * jnp.linalg.norm(step)  # False for NaN, too
        return jnp.where(small & ~trial.failed, a / 2, 0)

    return step + lax.cond(wanted, correction, lambda: jnp.zeros_like(step))
