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
from .problem import FitProblem, Outcome


class StageState(NamedTuple):
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

    def confirms(self, problem: FitProblem, z) -> bool:
        """Whether z, to which small steps led, is a minimum of the whole problem."""
        return self.method.confirms(problem, z)

    @eqx.filter_jit
    def begin(self, z, damping: float | Array = FAR, stages: bool = True) -> StageState:
        """Before anything was evaluated; without `stages` the whole problem comes at once."""
        end, infinite = jnp.asarray(-jnp.inf if stages else jnp.inf, z.dtype), jnp.asarray(jnp.inf, z.dtype)
        none = jnp.array(0)
        return StageState(self.method.begin(z, damping), end, jnp.array(stages), z, infinite, none, none, z)

    def step(self, problem: FitProblem, state: StageState) -> tuple[StageState, Outcome, Any]:
        """One step of the optimizer on the present stage, or the first evaluation of the next one if that is over.

        A stage whose first motion fails is left out.
        """
        begins, growth = state.over, self.growth
        state = self._beginning(state)
        stage = Stage(growth, state.anchor, state.end, begins)
        inner, outcome, linearised = self.method.step(dataclasses.replace(problem, stage=stage), state.inner)
        better = outcome.accepted & ~outcome.trial.failed & (outcome.loss <= state.loss)
        z, loss = (jnp.where(better, new, old) for new, old in
                   ((outcome.z, state.z), (outcome.loss, state.loss)))  # fmt: skip
        trials, taken = state.trials + ~outcome.first, state.taken + (outcome.accepted & ~outcome.first)
        over = outcome.in_stage & (outcome.ends | (taken >= growth.steps) | (trials >= growth.trials))
        new = StageState(inner, outcome.trial.end, jnp.asarray(over), z, loss, trials, taken, state.anchor)
        return new, outcome, linearised

    def _beginning(self, state: StageState) -> StageState:
        """The same, or with a new optimizer at the best point if a stage is over."""
        damping = jnp.where(jnp.isneginf(state.end), FAR, NEAR)
        new = self.begin(state.z, damping)._replace(end=state.end, anchor=state.anchor)
        fresh = lambda new, old: jnp.where(state.over, new, old) if eqx.is_array(old) else old
        return jax.tree.map(fresh, new, state)
