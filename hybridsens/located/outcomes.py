"""What comparisons come to, and the guards that tell where that changes."""

from typing import NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
from jax import lax
from jaxtyping import Array, Bool, Float, Int


class Differences(NamedTuple):
    """How far what is compared is apart."""

    surface: Float[Array, "surface"]
    """greater - less"""
    step: Float[Array, "step"]
    """What the floors are of."""


class Which(NamedTuple):
    """Some of the outcomes."""

    surface: Bool[Array, "surface"]
    step: Bool[Array, "step"]


class Outcomes(eqx.Module):
    """What all comparisons of a function come to."""

    above: Bool[Array, "surface"]
    """Whether greater > less."""
    whole: Float[Array, "step"]
    """The floors."""

    @property
    def guard_count(self) -> int:
        """How many guards tell where one changes: a floor changes at two places."""
        return self.above.size + 2 * self.whole.size

    def guards(self, found: Differences) -> Float[Array, "guard"]:
        """Guards that fall where an outcome changes; a bound at infinity stays away."""
        sided = jnp.where(self.above, found.surface, -found.surface)
        sided = jnp.where(jnp.isinf(sided), 1.0, sided)
        # One guard for even places and one for odd ones: at a place that is passed its guard turns, and no other one
        # comes to zero.
        down, up, even = found.step - self.whole, self.whole + 1 - found.step, _is_even(self.whole)
        return jnp.concatenate([sided, jnp.where(even, down, up), jnp.where(even, up, down)])

    def of_guard(self, guard: Int[Array, ""]) -> Which:
        """The one that changes where this guard falls; none for a number that is none of theirs."""
        count, size = self.above.size, self.whole.size
        step = guard - count
        return Which(jnp.arange(count) == guard, (jnp.arange(size) == step) | (jnp.arange(size) == step - size))

    def passed(self, guard: Int[Array, ""], found: Differences) -> "Outcomes":
        """The outcomes after this guard fell; of a floor the next number, or where a jump has led to."""
        count, size = self.above.size, self.whole.size
        number, there, even = jnp.arange(size), jnp.floor(lax.stop_gradient(found.step)), _is_even(self.whole)
        at_even, at_odd = number == guard - count, number == guard - count - size
        down, up = jnp.where(even, at_even, at_odd), jnp.where(even, at_odd, at_even)
        whole = jnp.where(up, jnp.maximum(self.whole + 1, there), self.whole)
        whole = jnp.where(down, jnp.minimum(self.whole - 1, there), whole)
        return Outcomes(self.above ^ (jnp.arange(count) == guard), whole)

    def stopped(self, on_zero: Bool[Array, "guard"], at_equality, but: Which) -> "Outcomes":
        """The outcomes where some guards rest on zero: a floor whose upper guard does has come to the next number."""
        count, size = self.above.size, self.whole.size
        at_even, at_odd = on_zero[count : count + size], on_zero[count + size :]
        up = jnp.where(_is_even(self.whole), at_odd, at_even)
        here = self.replaced(Outcomes(jnp.asarray(at_equality), self.whole + 1), Which(on_zero[:count], up))
        return here.replaced(self, but)

    def replaced(self, by: "Outcomes", where: Which) -> "Outcomes":
        """These, and some of others."""
        above, whole = jnp.where(where.surface, by.above, self.above), jnp.where(where.step, by.whole, self.whole)
        return Outcomes(above, whole)


def _is_even(whole: jax.Array) -> jax.Array:
    return whole % 2 == 0
