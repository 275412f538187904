"""An optimizer that fits stages of a growing horizon before the whole problem, all in one loop of one kind of step."""

from typing import Any, NamedTuple

import equinox as eqx
import jax.numpy as jnp
from jax import lax
from jaxtyping import Array, Bool, Float, Int

from .horizon import GrowingHorizon
from .optimizers import FAR, NEAR, Method
from .outcome import Outcome


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
    def begin(self, z, damping: float = FAR, stages: bool = True) -> Standing:
        """Before anything was evaluated; without `stages` the whole problem comes at once."""
        end, infinite = jnp.asarray(-jnp.inf if stages else jnp.inf, z.dtype), jnp.asarray(jnp.inf, z.dtype)
        none = jnp.array(0)
        return Standing(self.method.begin(z, damping), end, jnp.array(stages), z, infinite, none, none, z)

    def step(self, problem, standing: Standing) -> tuple[Standing, Outcome, Any]:
        """One step of the optimizer on the present stage's problem, or on the next one's if that stage is over.

        A stage whose first motion fails is left out.
        """
        standing = self._in_its_stage(problem, standing)
        stage = self.growth.stage(problem, standing.anchor, standing.end)
        inner, outcome, linearised = self.method.step(stage, standing.inner)
        outcome = outcome._replace(end=standing.end)
        better = outcome.accepted & ~outcome.trial.failed & (outcome.loss <= standing.loss)
        z, loss = (jnp.where(better, new, old) for new, old in
                   ((outcome.z, standing.z), (outcome.loss, standing.loss)))  # fmt: skip
        trials, taken = standing.trials + ~outcome.first, standing.taken + (outcome.accepted & ~outcome.first)
        full = (taken >= self.growth.steps) | (trials >= self.growth.trials)
        over = outcome.in_stage & (outcome.ends | full)
        return Standing(inner, standing.end, over, z, loss, trials, taken, standing.anchor), outcome, linearised

    def _in_its_stage(self, problem, standing: Standing) -> Standing:
        """The same, or the beginning of the next stage."""
        arrays, static = eqx.partition(standing, eqx.is_array)
        following = lambda: eqx.filter(self._next(problem, standing), eqx.is_array)
        return eqx.combine(lax.cond(standing.over, following, lambda: arrays), static)

    def _next(self, problem, standing: Standing) -> Standing:
        """At the first evaluation of the next stage, or of the whole problem."""
        z, none = standing.z, jnp.isneginf(standing.end)
        end = self.growth.next(problem, z, standing.end)
        inner = self.method.begin(z, jnp.where(jnp.isposinf(end) & ~none, NEAR, FAR))
        nothing = self.begin(z)
        return nothing._replace(inner=inner, end=end, over=jnp.array(False), anchor=standing.anchor)
