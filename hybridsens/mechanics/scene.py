"""What a user writes: the state of a mechanical system and the scene that moves it."""

import abc
from typing import ClassVar

import equinox as eqx
import jax.numpy as jnp
import lineax as lx
from jaxtyping import Array, Float

from ..export.text import printed
from ..model import Model


class State(eqx.Module):
    """Configuration and velocity of a scene: q (dof,) and v = q' (dof,)."""

    q: Float[Array, "*batch dof"]
    """Generalised coordinates [m or rad]."""
    v: Float[Array, "*batch dof"]
    """Generalised velocities, q' [m/s or rad/s]."""

    def __init__(self, q, v):
        self.q = _as_float("q", q)
        self.v = _as_float("v", v)

    def __repr__(self) -> str:
        return printed(self)


class AbstractScene(Model):
    """A mechanical system with ideal unilateral constraints.

        M(q) v' = F(t, q, v) + G lambda,   0 <= lambda _|_ Phi(t, q) >= 0,   G = (dPhi/dq)^T      (1.1)-(1.2)

    Subclass it, give it fields and these four methods; `jump_times` where forces or gaps have kinks or jumps at known
    times. Every array field is a parameter: gradients of a cost of the motion come back in a scene of the same class.
    A number, or a list of numbers, given for a field that is declared as an array is made one; fields declared as
    `float` or `int` are constants, whose gradient is None.
    """

    sustained_contact: ClassVar[bool] = True
    """Set to False in a scene whose contacts never stay closed: then no multiplier is solved for and no release
    is watched. A contact that would stay closed all the same ends the run with a status."""

    coordinates: ClassVar[tuple[str, ...] | None] = None
    """Names of the entries of q, with units in brackets, ("position [m]", "angle [rad]"): for tables and pictures."""

    contacts: ClassVar[tuple[str, ...] | None] = None
    """Names of the gaps, ("floor", "wall"): for tables and pictures. A gap that is no length has its unit there."""

    known_discontinuities: ClassVar[bool] = False
    """Set to True in a scene whose functions have kinks or jumps in t, q or v that do no harm: then no
    `DiscontinuityWarning` tells of them. A guard against a division by zero, `jnp.where(r > 0, r, 1)`, is such a one:
    its trace looks like that of a jump."""

    located_discontinuities: ClassVar[bool] = False
    """Set to True in a scene whose comparisons are to be events: `jnp.where(q[0] > 0, ...)`, `jnp.abs`, `jnp.maximum`,
    `jnp.minimum`, `jnp.clip`, `jnp.sign`, `relu`, `jnp.floor`, `jnp.round`, `%`, `jnp.argmax` of t, q and v in `force`,
    `gap` and running costs. Then each keeps its outcome until what it compares is equal, a step ends there, and values
    and gradients are as exact as for a switch of your own. These events are listed as switches, numbered behind those
    of the scene, and take part in `max_events`. Left alone are the mass matrix, tables, sorting, comparisons of
    integers and those in loops and branches of `jax.lax.cond`. A motion that slides along such a jump, as dry friction
    at rest does, ends with a status."""

    @abc.abstractmethod
    def mass_matrix(self, q: Float[Array, "dof"]) -> Float[Array, "dof dof"] | lx.AbstractLinearOperator:
        """Symmetric positive definite mass matrix M(q) [kg, kg m^2]: an array, or a `lineax` operator that knows more.

        - `lineax.DiagonalLinearOperator(m)` of masses m (dof,): M^-1 F is a division, in place of an elimination.
        - `lineax.TridiagonalLinearOperator(diagonal, lower, upper)`: O(dof), in place of O(dof^3).
        - `lineax.IdentityLinearOperator`: nothing is solved.
        - Any other one is made an array.

        An array that does not depend on q is told from the trace and inverted once; the identity is seen through.
        Symmetry and definiteness are asked at the start, and at every event and at the end where M depends on q: status
        `bad_mass_matrix`.
        """

    @abc.abstractmethod
    def force(self, t: Float[Array, ""], q: Float[Array, "dof"], v: Float[Array, "dof"]) -> Float[Array, "dof"]:
        """All smooth generalised forces F(t, q, v), those quadratic in the velocity included [N, N m]."""

    @abc.abstractmethod
    def gap(self, t: Float[Array, ""], q: Float[Array, "dof"]) -> Float[Array, "contact"]:
        """Gaps Phi(t, q) >= 0 [m]; shape (0,) where there are no contacts."""

    @abc.abstractmethod
    def restitution(self) -> Float[Array, "contact"]:
        """Newton's coefficient of restitution of each contact, in [0, 1]."""

    def jump_times(self) -> Float[Array, "jump"] | None:
        """Times at which a force has a kink or a jump, or a gap a kink (knots of a control, say): steps end there, and
        gradients reach them. None, the default, for none."""
        return None

    def _load(self, t, q, v):
        """The forces that may let a held contact go inside a step: all, unless a scene tells those of inertia apart."""
        return self.force(t, q, v)


def _as_float(name: str, value):
    try:
        array = jnp.asarray(value)
        return array if jnp.issubdtype(array.dtype, jnp.inexact) else array.astype(jnp.result_type(float))
    except (TypeError, ValueError, OverflowError, NotImplementedError) as error:
        raise TypeError(f"`{name}` of a State must hold real numbers, but is {type(value).__name__}.") from error
