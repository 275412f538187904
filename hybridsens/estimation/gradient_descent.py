"""Steps of Optax optimizers (Adam, L-BFGS ...) on the reverse-mode gradient, guarded against trial points that fail."""

from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import optax
from jax import lax
from jaxtyping import Array, Float

from ..adjoint.methods import Replay
from .problem import Outcome, Trial

_SMALL_STEP = 1e-9
_PATIENCE = 12


class Carry(NamedTuple):
    """Where an optimizer stands."""

    z: Float[Array, "unknown"]
    state: Any
    """The Optax optimizer's own state."""
    loss: Float[Array, ""]
    """inf before the first evaluation."""
    gradient: Float[Array, "unknown"]
    shrink: Float[Array, ""]
    """Factor on the next update; halved when a trial point is rejected, doubled (up to 1) when one is taken."""


def loss_and_gradient(problem, z) -> tuple[Float[Array, ""], Float[Array, "unknown"], Trial]:
    """sum r^2 / 2, its gradient by the adjoint, and what happened; failed if any of them is not finite."""
    (value, trial), gradient = jax.value_and_grad(_loss, has_aux=True)(z, problem)
    return value, gradient, trial._replace(failed=trial.failed | ~jnp.all(jnp.isfinite(gradient)))


def _loss(z, problem) -> tuple[Float[Array, ""], Trial]:
    r, trial = problem.residuals(z, Replay())
    return 0.5 * jnp.sum(r**2), trial


@eqx.filter_jit
def begin(optimizer: optax.GradientTransformation, z) -> Carry:
    """An optimizer at z that has evaluated nothing yet; its first step does."""
    return Carry(z, optimizer.init(z), jnp.asarray(jnp.inf, z.dtype), jnp.zeros_like(z), jnp.ones_like(z[0]))


def step(optimizer: optax.GradientTransformation, problem, carry: Carry) -> tuple[Carry, Outcome, None]:
    """One iteration. A trial point that failed is not taken, and the next update is half as long."""
    z, state, loss, gradient, shrink = carry
    first = jnp.isinf(loss)
    nothing = lambda: (jnp.zeros_like(z), state)
    updates, new_state = lax.cond(first, nothing, lambda: _update(optimizer, problem, carry))
    at = jnp.where(jnp.all(jnp.isfinite(updates)), z + updates, z)
    new_loss, new_gradient, trial = loss_and_gradient(problem, at)
    accepted = ~trial.failed & jnp.all(jnp.isfinite(updates))
    longer, shorter = jnp.minimum(2 * shrink, 1), shrink / 2
    taken, kept = Carry(at, new_state, new_loss, new_gradient, longer), Carry(z, state, loss, gradient, shorter)
    carry = jax.tree.map(lambda a, b: jnp.where(accepted, a, b), taken, kept)
    still = jnp.max(jnp.abs(updates)) < _SMALL_STEP * (1 + jnp.max(jnp.abs(z)))
    outcome = Outcome(
        carry.z, carry.loss, jnp.linalg.norm(carry.gradient), accepted, converged=accepted & still & ~first,
        stalled=carry.shrink < 2.0**-_PATIENCE, first=first, trial=trial,
    )  # fmt: skip
    return carry, outcome, None


def _update(optimizer: optax.GradientTransformation, problem, carry: Carry):
    penalty = 100 * (1 + carry.loss)
    updates, state = optax.with_extra_args_support(optimizer).update(
        carry.gradient, carry.state, carry.z, value=carry.loss, grad=carry.gradient,
        value_fn=lambda z: _guarded_loss(z, problem, penalty),
    )  # fmt: skip
    return jax.tree.map(lambda u: carry.shrink * u, updates), state


@eqx.filter_custom_vjp
def _guarded_loss(z, problem, penalty):
    """The loss for line searches: finite, with a finite gradient, wherever they look."""
    loss, trial = _loss(z, problem)
    return jnp.where(trial.failed, penalty, loss)


@_guarded_loss.def_fwd
def _guarded_loss_fwd(perturbed, z, problem, penalty):
    del perturbed
    loss, gradient, trial = loss_and_gradient(problem, z)
    return jnp.where(trial.failed, penalty, loss), jnp.where(trial.failed, 0, gradient)


@_guarded_loss.def_bwd
def _guarded_loss_bwd(gradient, loss_bar, perturbed, z, problem, penalty):
    del perturbed, z, problem, penalty
    return loss_bar * gradient
