"""Steps of Optax optimizers (Adam, L-BFGS ...) on the reverse-mode gradient, guarded against trial points that fail."""

from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import optax
from jaxtyping import Array, Float

from ...adjoint.methods import Replay
from .outcome import Outcome
from .problem import Trial

_SMALL_STEP = 1e-9
_PATIENCE = 12


class Carry(NamedTuple):
    """Where an optimizer stands."""

    z: Float[Array, "unknown"]
    state: Any
    """The Optax optimizer's own state."""
    loss: Float[Array, ""]
    gradient: Float[Array, "unknown"]
    shrink: Float[Array, ""]
    """Factor on the next update; halved when a trial point is rejected, doubled (up to 1) when one is taken."""


def loss_and_gradient(problem, z) -> tuple[Float[Array, ""], Float[Array, "unknown"], Trial]:
    """sum r^2 / 2, its gradient by the adjoint, and what happened; failed if any of them is not finite."""

    def loss(z):
        r, trial = problem.residuals(z, Replay())
        return 0.5 * jnp.sum(r**2), trial

    (value, trial), gradient = jax.value_and_grad(loss, has_aux=True)(z)
    return value, gradient, trial._replace(failed=trial.failed | ~jnp.all(jnp.isfinite(gradient)))


@eqx.filter_jit
def start(optimizer: optax.GradientTransformation, problem, z) -> tuple[Carry, Outcome]:
    """An optimizer that knows value and gradient at z."""
    loss, gradient, trial = loss_and_gradient(problem, z)
    norm, no = jnp.linalg.norm(gradient), jnp.array(False)
    outcome = Outcome(z, loss, norm, ~trial.failed, converged=no, stalled=no, trial=trial)
    return Carry(z, optimizer.init(z), loss, gradient, jnp.ones(())), outcome


@eqx.filter_jit
def step(optimizer: optax.GradientTransformation, problem, carry: Carry) -> tuple[Carry, Outcome]:
    """One iteration. A trial point that failed is not taken, and the next update is half as long."""
    z, state, loss, gradient, shrink = carry
    penalty = 100 * (1 + loss)
    updates, new_state = optax.with_extra_args_support(optimizer).update(
        gradient, state, z, value=loss, grad=gradient, value_fn=lambda z: _guarded_loss(z, problem, penalty)
    )
    updates = jax.tree.map(lambda u: shrink * u, updates)
    at = jnp.where(jnp.all(jnp.isfinite(updates)), z + updates, z)
    new_loss, new_gradient, trial = loss_and_gradient(problem, at)
    accepted = ~trial.failed & jnp.all(jnp.isfinite(updates))
    longer, shorter = jnp.minimum(2 * shrink, 1), shrink / 2
    taken, kept = Carry(at, new_state, new_loss, new_gradient, longer), Carry(z, state, loss, gradient, shorter)
    carry = jax.tree.map(lambda a, b: jnp.where(accepted, a, b), taken, kept)
    still = jnp.max(jnp.abs(updates)) < _SMALL_STEP * (1 + jnp.max(jnp.abs(z)))
    outcome = Outcome(
        carry.z, carry.loss, jnp.linalg.norm(carry.gradient), accepted, converged=accepted & still,
        stalled=carry.shrink < 2.0**-_PATIENCE, trial=trial,
    )  # fmt: skip
    return carry, outcome


@eqx.filter_custom_vjp
def _guarded_loss(z, problem, penalty):
    """The loss for line searches: finite, with a finite gradient, wherever they look."""
    r, trial = problem.residuals(z, Replay())
    return jnp.where(trial.failed, penalty, 0.5 * jnp.sum(r**2))


@_guarded_loss.def_fwd
def _guarded_loss_fwd(perturbed, z, problem, penalty):
    del perturbed
    loss, gradient, trial = loss_and_gradient(problem, z)
    return jnp.where(trial.failed, penalty, loss), jnp.where(trial.failed, 0, gradient)


@_guarded_loss.def_bwd
def _guarded_loss_bwd(gradient, loss_bar, perturbed, z, problem, penalty):
    del perturbed, z, problem, penalty
    return loss_bar * gradient
