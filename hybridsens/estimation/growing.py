"""An optimizer that fits stages of a growing horizon before the whole problem, all in one loop of one kind of step."""

import dataclasses
from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float, Int

from .horizon import GrowingHorizon, Stage
from .least_squares import FAR, NEAR
from .optimizers import Method
from .outcome import Outcome
from .problem import Problem


class Standing(NamedTuple):
    """Where the stages stand."""

    inner: Any
    """The optimizer's own state."""
    end: Float[Array, ""]
    """Where the present stage's horizon ends; -inf before the first stage, inf in the whole problem."""
    over: Bool[Array, ""]
    """The stage has ended: the next step begins another one."""
    z: Float[Array, "unknown"]
    loss: Float[Array, ""]
    """The best point of this stage, or of the one before as long as this one has none."""
    trials: Int[Array, ""]
    taken: Int[Array, ""]
    """Trial points and accepted ones of this stage, beside the first."""
    anchor: Float[Array, "unknown"]
    """The guess, near which stages are held."""


class Growing(eqx.Module):
    """A `Method` that takes the stages of a `GrowingHorizon` first."""

    method: Method
    growth: GrowingHorizon

    @property
    def least_squares(self) -> bool:
        """Whether it uses residuals and their Jacobian."""
        return self.method.least_squares

    @eqx.filter_jit
    def begin(self, z, damping: float | Array = FAR, stages: bool = True) -> Standing:
        """Before anything was evaluated; without `stages` the whole problem comes at once."""
        end, infinite = jnp.asarray(-jnp.inf if stages else jnp.inf, z.dtype), jnp.asarray(jnp.inf, z.dtype)
        none = jnp.array(0)
        return Standing(self.method.begin(z, damping), end, jnp.array(stages), z, infinite, none, none, z)

    def step(self, problem: Problem, standing: Standing) -> tuple[Standing, Outcome, Any]:
        """One step of the optimizer on the present stage, or the first evaluation of the next one if that is over.

        A stage whose first motion fails is left out.
        """
        begins, growth = standing.over, self.growth
        standing = self._beginning(standing)
        stage = Stage(growth, standing.anchor, standing.end, begins)
        inner, outcome, linearised = self.method.step(dataclasses.replace(problem, stage=stage), standing.inner)
        better = outcome.accepted & ~outcome.trial.failed & (outcome.loss <= standing.loss)
        z, loss = (jnp.where(better, new, old) for new, old in
                   ((outcome.z, standing.z), (outcome.loss, standing.loss)))  # fmt: skip
        trials, taken = standing.trials + ~outcome.first, standing.taken + (outcome.accepted & ~outcome.first)
        over = outcome.in_stage & (outcome.ends | (taken >= growth.steps) | (trials >= growth.trials))
        new = Standing(inner, outcome.trial.end, jnp.asarray(over), z, loss, trials, taken, standing.anchor)
        return new, outcome, linearised

    def _beginning(self, standing: Standing) -> Standing:
        """The same, or with a new optimizer at the best point if a stage is over."""
        damping = jnp.where(jnp.isneginf(standing.end), FAR, NEAR)
        new = self.begin(standing.z, damping)._replace(end=standing.end, anchor=standing.anchor)
        fresh = lambda new, old: jnp.where(standing.over, new, old) if eqx.is_array(old) else old
        return jax.tree.map(fresh, new, standing)
