"""A scene as a hybrid system: the only face of the mechanics that the solvers see."""

import dataclasses
from collections.abc import Callable
from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
from jax import lax
from jaxtyping import Array, Float

from ..hybrid import AbstractHybridSystem, Decision, Searched, StepEnds
from ..interval.kind import Kind
from ..short import any_of
from .clearance import gap_kinds, search_gaps
from .contact import contact_geometry, gap_and_rate
from .flow import acceleration, free_acceleration, multipliers, multipliers_and_rates, project_to_contacts
from .laws import transition_impulse
from .mode import ContactMode
from .path import Path
from .resets import ImpactDetail, decide_transition
from .scene import AbstractScene


class ImpactReport(NamedTuple):
    """What is reported of an event."""

    impulse: Float[Array, "contact"]
    """Impulses P of all contacts [N s]."""
    closing_speed: Float[Array, ""]
    """-Phi' of the contact that was met, just before; 0 at a release [m/s]."""


class MechanicalSystem(AbstractHybridSystem):
    """State x = (q, v, z) with z' = running cost; guard i is the gap of contact i, or its multiplier while it is
    held."""

    scene: AbstractScene
    running_cost: Callable[..., Any] | None
    """running_cost(scene, t, q, v): a scalar or a PyTree; None where there is none."""
    capture_speed: float = eqx.field(static=True)
    """Rebound speed, relative to the contact's fastest impact so far, below which it is captured."""
    dof: int = eqx.field(static=True)
    depth: tuple[Any, Any] = (0.0, 0.0)
    """(relative, absolute) penetration that the tolerances can resolve: a touch less deep is grazing."""
    free: bool = eqx.field(default=False, static=True)
    """Whether this is the system as it moves while every contact is open."""

    def split(self, x):
        """q, v, z of a flat state (leading axes are kept)."""
        return x[..., : self.dof], x[..., self.dof : 2 * self.dof], x[..., 2 * self.dof :]

    def flow(self, t, x, mode: ContactMode):
        """(q, v, z)' = (v, M^-1 (F + G_A lambda_A), l(t, q, v)); (1.1) with (T1)."""
        q, v, _ = self.split(x)
        constrained = lambda: acceleration(self.scene, t, q, v, mode.active)
        parts = [v, free_acceleration(self.scene, t, q, v) if self.free else constrained()]
        if self.running_cost is not None:
            parts += [jnp.ravel(leaf) for leaf in jax.tree.leaves(self.running_cost(self.scene, t, q, v))]
        return jnp.concatenate([part.astype(x.dtype) for part in parts])

    def guards(self, t, x, mode: ContactMode):
        """Phi_i where the contact is open, lambda_i where it is held."""
        q, v, _ = self.split(x)
        gap = self.scene.gap(t, q) + mode.margin
        if not self.scene.sustained_contact:
            return gap
        return lax.cond(
            any_of(mode.active),
            lambda: jnp.where(mode.active, multipliers(self.scene, t, q, v, mode.active), gap),
            lambda: gap,
        )

    def guards_and_rates(self, t, x, mode: ContactMode):
        """As the general rule, but an open contact's rate Phi' costs no flow and no multiplier."""
        q, v, _ = self.split(x)
        gap, rate = gap_and_rate(self.scene, t, q, v)
        gap = gap + mode.margin
        if not self.scene.sustained_contact:
            return gap, rate

        def with_multipliers():
            multiplier, multiplier_rate = multipliers_and_rates(self.scene, t, q, v, mode.active)
            return jnp.where(mode.active, multiplier, gap), jnp.where(mode.active, multiplier_rate, rate)

        return lax.cond(any_of(mode.active), with_multipliers, lambda: (gap, rate))

    def searches(self, t, x):
        """Whether a gap is curved: what is affine in (t, q) cannot dip unseen. Told from the trace of the gaps."""
        return bool((gap_kinds(self.scene, t, self.split(x)[0])[0] >= Kind.CURVED).any())

    def search(self, step: StepEnds, mode: ContactMode, tolerance, wanted) -> Searched:
        """The gaps of open contacts, along the cubic through the ends of the step and within what it may be off."""
        q0, v0, _ = self.split(step.x0)
        q1, v1, _ = self.split(step.x1)
        path = Path.through(step.t0, step.t1, q0, v0, q1, v1)
        speed = jnp.maximum(mode.speed, jnp.maximum(jnp.abs(step.rate0), jnp.abs(step.rate1)))
        doubt = path.doubt(self.split(step.error)[0], step.order) * path.h * speed
        return search_gaps(self.scene, path, step, tolerance + doubt, ~mode.held, wanted)

    def scales(self, t, x, mode: ContactMode):
        """|G|^T |q| and |G|^T |v|, the largest so far; a multiplier's scale is not known and counts as 0."""
        return jnp.where(mode.active, 0, mode.length), jnp.where(mode.active, 0, mode.speed)

    def grazing_depth(self, mode: ContactMode):
        """What the tolerances leave of the gap of an open contact."""
        relative, absolute = self.depth
        return jnp.where(mode.held, -1, relative * mode.length + absolute)

    def decide(self, event, t, x, mode: ContactMode) -> Decision:
        """Impact, capture or release, and who is held after it; see `decide_transition`."""
        q, v, _ = self.split(x)
        return decide_transition(self.scene, self.capture_speed, self.depth, event, t, q, v, mode)

    def choose(self, event, t, x, mode: ContactMode) -> Decision:
        """The contacts that the initial state holds closed are chosen by the same laws (T2), without an impact."""
        return self.decide(event, t, x, mode)

    def reset(self, decision: Decision, t, x):
        """v+ = v- + M^-1 G P, q and z unchanged (1.7), (T3); emits the impulses and the closing speed."""
        q, v, _ = self.split(x)
        detail: ImpactDetail = decision.detail
        geometry = contact_geometry(self.scene, t, q)
        _, rate = gap_and_rate(self.scene, t, q, v)
        restitution = jnp.where(detail.plastic, 0, self.scene.restitution())
        impulse = transition_impulse(geometry, rate, restitution, detail.support, detail.settled)
        closing_speed = jnp.sum(jnp.where(detail.fired, -rate, 0))
        after = x.at[self.dof : 2 * self.dof].add(geometry.mobility @ impulse)
        return after, ImpactReport(impulse, closing_speed)

    def project(self, t, x, mode: ContactMode):
        """Held contacts back to Phi = 0 and Phi' = 0."""
        if self.free or not self.scene.sustained_contact or mode.active.shape[0] == 0:
            return x

        def projected():
            q, v, z = self.split(x)
            return jnp.concatenate([*project_to_contacts(self.scene, t, q, v, mode.active, mode.held_gap), z])

        return lax.cond(any_of(mode.active), projected, lambda: x)

    def unconstrained(self, mode: ContactMode):
        """While every contact is open, v' = M^-1 F: no multipliers, nothing to project."""
        if self.free or not self.scene.sustained_contact or mode.active.shape[0] == 0:
            return None
        return ~any_of(mode.active), dataclasses.replace(self, free=True)
