"""A scene as a hybrid system: the only face of the mechanics that the solvers see."""

import dataclasses
from collections.abc import Callable
from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
from jax import lax
from jaxtyping import Array, Float

from ..flat_system import AbstractFlatSystem, Decision, Searched, StepEnds
from ..interval.kind import Kind
from ..numerics.fixed import Fixed, number
from ..numerics.tolerances import closeness
from ..observables import EventMarks, EventStates
from ..search.gap_search import gap_kinds, search_gaps, warn_of_sampled
from ..search.path import Path
from ..search.stretch import Nearness
from ..status import Status
from ..until import ends_with
from .contact import FEW, Among, Instant, among_wanted, contact_geometry, gap_and_rate
from .decisions import ImpactDetail, Limits, decide_transition
from .events import Events, reported_events
from .flow import acceleration, free_acceleration, multipliers, multipliers_and_rates, project_to_contacts
from .held import load_varies, search_load, search_way, supports_move
from .laws import transition_impulse
from .located import own_scene
from .mode import ROUNDED, ContactMode
from .scene import AbstractScene
from .smoothness import is_not_smooth
from .status import ContactStatus
from .wrapped import as_written


class ImpactReport(NamedTuple):
    """What is reported of an event."""

    impulse: Float[Array, "contact"]
    """Impulses P of all contacts [N s]."""
    closing_speed: Float[Array, ""]
    """-Phi' of the contact that was met, just before; 0 at other events [m/s]."""


class MechanicalSystem(AbstractFlatSystem):
    """State x = (q, v, z) with z' = running cost; guard i is the gap of contact i, or its multiplier while it is
    active."""

    scene: AbstractScene
    running_cost: Callable[..., Any] | None
    """running_cost(scene, t, q, v): a scalar or a PyTree; None where there is none."""
    capture_speed: float | Fixed
    """Rebound speed, relative to the contact's fastest impact so far, below which it is captured."""
    dof: int = eqx.field(static=True)
    depth: tuple[Any, Any] = (0.0, 0.0)
    """(relative, absolute) penetration that the tolerances can resolve: a touch less deep is grazing."""
    jump_ts: Float[Array, "jump"] | None = None
    """Times at which a force has a kink or a jump, or a gap a kink."""
    until: Callable[..., Any] | None = None
    """until(scene, event): whether the motion ends with an event; None where it goes on to t1."""
    free: bool = eqx.field(default=False, static=True)
    """Whether this is the system as it moves while every contact is open."""
    program: str = eqx.field(default="", static=True)
    """What its functions compute: where they read from elsewhere, two systems of one class may differ in that alone."""

    def split(self, x):
        """q, v, z of a flat state (leading axes are kept)."""
        return x[..., : self.dof], x[..., self.dof : 2 * self.dof], x[..., 2 * self.dof :]

    def flow(self, t, x, mode: ContactMode):
        """(q, v, z)' = (v, M^-1 (F + G_A lambda_A), l(t, q, v)); (1.1) with (T1)."""
        q, v, _ = self.split(x)
        constrained = lambda: acceleration(self.scene, t, q, v, mode.active)
        parts = [v, free_acceleration(self.scene, t, q, v) if self.free else constrained()]
        parts += [jnp.ravel(leaf) for leaf in jax.tree.leaves(self.cost_rate(t, q, v))]
        return jnp.concatenate([part.astype(x.dtype) for part in parts])

    def cost_rate(self, t, q, v):
        """Running cost at one instant, with its structure; None where there is none."""
        return None if self.running_cost is None else self.running_cost(as_written(self.scene), t, q, v)

    def guards(self, t, x, mode: ContactMode):
        """Phi_i where the contact is not active, lambda_i where it is."""
        q, v, _ = self.split(x)
        gap = self.scene.gap(t, q)
        if not self.scene.sustained_contact:
            return gap + mode.margin
        guard = lax.cond(
            jnp.any(mode.active),
            lambda: jnp.where(mode.active, multipliers(self.scene, t, q, v, mode.active), gap),
            lambda: gap,
        )
        return guard + mode.margin

    def guards_and_rates(self, t, x, mode: ContactMode):
        """As the general rule, but an open contact's rate Phi' costs no flow and no multiplier."""
        q, v, _ = self.split(x)
        gap, rate = gap_and_rate(self.scene, t, q, v)
        if not self.scene.sustained_contact:
            return gap + mode.margin, rate

        def with_multipliers():
            multiplier, multiplier_rate = multipliers_and_rates(self.scene, t, q, v, mode.active)
            return jnp.where(mode.active, multiplier, gap), jnp.where(mode.active, multiplier_rate, rate)

        guard, rate = lax.cond(jnp.any(mode.active), with_multipliers, lambda: (gap, rate))
        return guard + mode.margin, rate

    def warn_of_sampled(self, t, x):
        """Say which gaps are only sampled inside a step, and which forces; of these it is known where declared times
        break them."""
        q, v, _ = self.split(x)
        warn_of_sampled("Gaps", self.scene.gap, t, q)
        if self._load_varies(t, x) and self.jump_ts is None:
            warn_of_sampled("Forces on held contacts", lambda t, q: self.scene._load(t, q, v), t, q)

    def searches(self, t, x):
        """Whether a gap is curved (what is affine in (t, q) cannot dip unseen), or a load may let a held contact go."""
        return self._has_curved_gaps(t, x) or self._load_varies(t, x)

    def _has_curved_gaps(self, t, x) -> bool:
        return bool((gap_kinds(self.scene.gap, t, self.split(x)[0])[0] >= Kind.CURVED).any())

    def _load_varies(self, t, x) -> bool:
        q, v, _ = self.split(x)
        return self.scene.sustained_contact and (load_varies(self.scene, t, q, v) or supports_move(self.scene, t, q))

    def search(self, step: StepEnds, mode: ContactMode, tolerance, wanted) -> Searched:
        """Gaps of open contacts, within what the cubic through the step is off by; held gaps; and multipliers."""
        (q0, v0, _), (q1, v1, _) = self.split(step.x0), self.split(step.x1)
        path = Path.through(step.t0, step.t1, q0, v0, q1, v1)
        # The largest speed so far may be that of an impact long ago: dips would be lost in the doubt of a slow motion.
        speed = jnp.minimum(mode.speed, jnp.max(path.ways()) / path.h)
        speed = jnp.maximum(speed, jnp.maximum(jnp.abs(step.rate0), jnp.abs(step.rate1)))
        position_error = path.doubt(self.split(step.error)[0], step.order) * path.h * speed
        found = []
        if self._has_curved_gaps(step.t0, step.x0):
            nearness = Nearness(tolerance, position_error, self.grazing_depth(mode))
            found.append(search_gaps(self.scene.gap, path, step, nearness, wanted))
            if self.scene.sustained_contact:
                found.append(search_way(self.scene, path, step, mode, self._resolved(mode), wanted))
        if self._load_varies(step.t0, step.x0):
            found.append(search_load(self.scene, path, step, mode, tolerance, wanted))
        return Searched.first_of(found)

    def scales(self, t, x, mode: ContactMode):
        """|G|^T |q| and |G|^T |v|, the largest so far. A multiplier's scale is not known and counts as 0, unless it is
        granted a pull: rounding is less than half of that."""
        of_pull = mode.margin / (2 * closeness(x.dtype))
        return jnp.where(mode.active, of_pull, mode.length), jnp.where(mode.active, 0, mode.speed)

    def clock_scales(self, t, mode: ContactMode):
        """|Phi_t| t, with the fastest wall so far."""
        return 0.0 if mode.wall is None else jnp.where(mode.active, 0, mode.clock_length(t))

    def grazing_depth(self, mode: ContactMode):
        """What the tolerances leave of the gap of an open contact."""
        return jnp.where(mode.held, -1, self._resolved(mode))

    def _resolved(self, mode: ContactMode):
        """Penetration that the tolerances can resolve, of each contact (contact,)."""
        relative, absolute = map(number, self.depth)
        return relative * mode.length + absolute

    def decide(self, event, t, x, mode: ContactMode) -> Decision:
        """Impact, capture or release, and which contacts are held after it; see `decide_transition`. At the start the
        contacts that the state holds closed are chosen by the same laws (T2), without an impact."""
        q, v, _ = self.split(x)
        relative, absolute = map(number, self.depth)
        limits = Limits(number(self.capture_speed), (relative, absolute))
        return decide_transition(self.scene, limits, event, Instant(t, q, v), mode)

    def reset(self, decision: Decision, t, x):
        """v+ = v- + M^-1 G P, q and z unchanged (1.7), (T3); emits the impulses and the closing speed."""
        q, v, _ = self.split(x)
        detail: ImpactDetail = decision.detail

        settles = self.scene.sustained_contact and detail.support.shape[0] > 1

        def among(scene, detail: ImpactDetail):
            geometry = contact_geometry(scene, t, q)
            _, rate = gap_and_rate(scene, t, q, v)
            restitution = jnp.where(detail.plastic, 0, scene.restitution())
            rests = detail.brought_to_rest if settles else None
            impulse = transition_impulse(geometry, rate, restitution, detail.support, rests).total
            return impulse, (geometry.mobility @ impulse, jnp.sum(jnp.where(detail.triggered, -rate, 0)))

        wanted = detail.triggered | detail.support | detail.brought_to_rest
        nothing = jnp.zeros(wanted.shape, x.dtype)
        # The impulses of an impact are at independent contacts, and so are those that bring to rest.
        at_most = 2 * self.dof + 1 if self.dof <= FEW else None
        impulse, (kick, closing_speed) = among_wanted(self.scene, wanted, Among(among, detail, nothing), at_most)
        after = x.at[self.dof : 2 * self.dof].add(kick)
        return after, ImpactReport(impulse, closing_speed)

    def jump_times(self):
        """Those declared, by the caller or by the scene."""
        return self.jump_ts

    def events(self, states: EventStates, marks: EventMarks) -> Events:
        """Events as they are reported."""
        return reported_events(states, marks, self.dof)

    def ends_with(self, states, marks):
        return ends_with(self.until, own_scene(self.scene), lambda: self.events(states, marks))

    def projects(self, mode: ContactMode):
        """Whether there can be held contacts."""
        return not self.free and self.scene.sustained_contact and mode.active.shape[0] > 0

    def project(self, t, x, mode: ContactMode):
        """Held contacts back to Phi = 0 and Phi' = 0."""
        if not self.projects(mode):
            return x

        def projected():
            q, v, z = self.split(x)
            found = project_to_contacts(self.scene, t, q, v, mode.active, mode.held_gap)
            return jnp.concatenate([found.q, found.v, z])

        return lax.cond(jnp.any(mode.active), projected, lambda: x)

    def project_with_error(self, t, x, mode: ContactMode):
        """What rounding leaves in a gap or in a rate is no error of a step: no shorter step would mend it."""
        nothing = jnp.zeros_like(x)
        if not self.projects(mode):
            return x, nothing

        def projected():
            q, v, z = self.split(x)
            found = project_to_contacts(self.scene, t, q, v, mode.active, mode.held_gap)
            drifts = jnp.any(jnp.abs(found.gap_error) > ROUNDED * mode.gap_tolerance(t))
            turns = jnp.any(jnp.abs(found.rate_error) > ROUNDED * closeness(x.dtype) * mode.speed)
            moved = [jnp.where(drifts, found.q - q, 0), jnp.where(turns, found.v - v, 0), jnp.zeros_like(z)]
            return jnp.concatenate([found.q, found.v, z]), jnp.concatenate(moved)

        return lax.cond(jnp.any(mode.active), projected, lambda: (x, nothing))

    def stuck(self, t, x, mode: ContactMode) -> Status:
        """Tells a gap that jumps or has a corner from forces that are stiff."""
        q, v, _ = self.split(x)
        not_smooth = is_not_smooth(self.scene, t, q, v, mode)
        return Status.where(not_smooth, ContactStatus.gap_not_smooth, Status.step_size_underflow)

    def unconstrained(self, mode: ContactMode):
        """While every contact is open, v' = M^-1 F: no multipliers, nothing to project."""
        if not self.projects(mode):
            return None
        return ~jnp.any(mode.active), dataclasses.replace(self, free=True)
