"""A scene with switches as a hybrid system: its contacts, and beside them the guards of its own."""

import dataclasses
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
from jax import lax
from jaxtyping import Array

from ..flat_system import FLOW_JUMP, START, AbstractFlatSystem, Decision, Searched, StepEnds
from ..interval.kind import Kind
from ..located.system import own_mode
from ..numerics.fixed import number as number_of
from ..numerics.tolerances import closeness, rounding
from ..observables import EventMarks, EventStates
from ..search.gap_search import gap_kinds, search_guards, warn_of_sampled
from ..status import Status
from ..until import ends_with
from ..watch import Seen, Watch, same_mode
from .decisions import Chosen, SwitchDetail
from .events import Events, reported_events
from .located import own_scene
from .mode import ContactMode, EventKind, SwitchedMode
from .switches import SwitchRules, in_mode
from .system import MechanicalSystem
from .wrapped import as_written


class SwitchedSystem(AbstractFlatSystem):
    """Events 0, 1, ... are those of the contacts, the switches follow. In each mode the contacts are those of a
    `MechanicalSystem`; after a switch they are chosen as after a jump of the forces."""

    mechanics: MechanicalSystem
    rules: SwitchRules
    switch_count: int = eqx.field(static=True)
    first_mode: Any
    """The scene's mode in which the motion begins."""

    def begin(self, mechanics: MechanicalSystem, mode: ContactMode, x) -> tuple["SwitchedSystem", SwitchedMode]:
        """The system with these mechanics, and the mode that it begins in at x; `decide` looks at its switches."""
        watch = Watch.blank(self.switch_count, x)
        return dataclasses.replace(self, mechanics=mechanics), SwitchedMode(mode, self.first_mode, watch)

    def within(self, own) -> MechanicalSystem:
        """The mechanics in a mode of the scene."""
        scene, running_cost = in_mode(self.mechanics.scene, self.mechanics.running_cost, own)
        return dataclasses.replace(self.mechanics, scene=scene, running_cost=running_cost)

    def flow(self, t, x, mode: SwitchedMode):
        return self.within(mode.own).flow(t, x, mode.contacts)

    def guards(self, t, x, mode: SwitchedMode):
        gaps = self.within(mode.own).guards(t, x, mode.contacts)
        return jnp.concatenate([gaps, mode.watch.signed(self._switches(t, x, mode.own))])

    def guards_and_rates(self, t, x, mode: SwitchedMode):
        gaps, gap_rates = self.within(mode.own).guards_and_rates(t, x, mode.contacts)
        seen = self._see(t, x, mode.own, mode.contacts, mode.watch)
        signed, rates = mode.watch.signed(seen.value), mode.watch.rates(mode.watch.signed(seen.rate))
        return jnp.concatenate([gaps, signed]), jnp.concatenate([gap_rates, rates])

    def _switches(self, t, x, own):
        q, v, _ = self.mechanics.split(x)
        return self.rules.switches(as_written(self.mechanics.scene), t, q, v, own).astype(x.dtype)

    def _see(self, t, x, own, contacts: ContactMode, watch: Watch) -> Seen:
        flow = self.within(own).flow(t, x, contacts)
        return watch.see(lambda t, x: self._switches(t, x, own), t, x, flow)

    def scales(self, t, x, mode: SwitchedMode):
        """Those of the contacts and of the switches."""
        contacts = self.within(mode.own).scales(t, x, mode.contacts)
        switches = mode.watch.scales(lambda t, x: self._switches(t, x, mode.own), t, x)
        size, speed = (jnp.concatenate(both) for both in zip(contacts, switches, strict=True))
        return size, speed

    def clock_scales(self, t, mode: SwitchedMode):
        """That of the contacts: `scales` holds that of the switches."""
        if mode.contacts.wall is None:
            return 0.0
        return jnp.concatenate([self.mechanics.clock_scales(t, mode.contacts), jnp.zeros_like(mode.watch.size)])

    def turning_scales(self, t, x, mode: SwitchedMode):
        """Those of the switches; `grazing_depth` judges the contacts."""
        switches = mode.watch.turning_scales(lambda t, x: self._switches(t, x, mode.own), t, x)
        no_contact = jnp.zeros_like(mode.contacts.length)
        size, speed = (jnp.concatenate([no_contact, scale]) for scale in switches)
        return size, speed

    def grazing_depth(self, mode: SwitchedMode):
        """A switch says nothing of how nearly it was missed."""
        return jnp.concatenate([self.mechanics.grazing_depth(mode.contacts), jnp.full_like(mode.watch.size, -1)])

    def warn_of_sampled(self, t, x):
        """Say which gaps and which switches are only sampled inside a step."""
        self.mechanics.warn_of_sampled(t, x)
        warn_of_sampled("Switches", lambda t, x: self._switches(t, x, self.first_mode), t, x)

    def searches(self, t, x):
        """Whether a gap or a switch is curved."""
        return self.mechanics.searches(t, x) or self._has_curved_switches(t, x)

    def _has_curved_switches(self, t, x) -> bool:
        return bool((gap_kinds(lambda t, x: self._switches(t, x, self.first_mode), t, x)[0] >= Kind.CURVED).any())

    def search(self, step: StepEnds, mode: SwitchedMode, tolerance, wanted) -> Searched:
        """Gaps and switches each by themselves; what is found first counts."""
        n = mode.contacts.active.shape[0]
        part = lambda cut: step._replace(
            guard0=step.guard0[cut], rate0=step.rate0[cut], guard1=step.guard1[cut], rate1=step.rate1[cut]
        )
        found = []
        if self.mechanics.searches(step.t0, step.x0):
            contacts = self.within(mode.own)
            found.append(contacts.search(part(slice(0, n)), mode.contacts, tolerance[:n], wanted))
        if self._has_curved_switches(step.t0, step.x0):
            found.append(self._search_switches(part(slice(n, None)), mode, tolerance[n:], wanted))
        return Searched.first_of(found)

    def _search_switches(self, step: StepEnds, mode: SwitchedMode, tolerance, wanted) -> Searched:
        switches = lambda t, x: mode.watch.signed(self._switches(t, x, mode.own))
        flow = lambda t, x: self.flow(t, x, mode)
        return search_guards(switches, flow, step, mode.watch.speed, tolerance, wanted)

    def decide(self, event, t, x, mode: SwitchedMode) -> Decision:
        """The mode after, of the scene and of its contacts, and which switches can fall then.

        After a switch the contacts are chosen anew (T2), as where the forces jump; a silent one leaves them."""
        number = event - mode.contacts.active.shape[0]  # of a switch; negative otherwise
        rises = mode.watch.is_silent(number)
        falls = (number >= 0) & ~rises
        after, own = lax.cond(falls, lambda: self._switch(number, t, x, mode.own), lambda: (x, mode.own))
        contacts = self.within(own).decide(jnp.where(number >= 0, FLOW_JUMP, event), t, after, mode.contacts)
        among = jax.tree.map(lambda new, old: jnp.where(rises, old, new), contacts.mode, mode.contacts)
        after, _ = self.within(own).reset(contacts, t, after)
        first = Chosen(own, among, contacts.status, self._see(t, after, own, among, mode.watch))
        # What rests by its own outcome keeps it; what a contact has stopped does not.
        by_itself = jnp.all(among.active == mode.contacts.active)
        chosen = self._at_rest(jnp.where(by_itself, number, -1), t, after, first, mode.watch)

        def switched():
            flow = self.flow(t, x, mode)
            before, same = mode.watch.compare(self._switches, (mode.own, chosen.own), t, x, flow)
            return mode.watch.after(number, t, before, same, chosen.seen, self._lift(t, after, chosen, mode.watch))

        begun = lambda: (mode.watch.begin(t, chosen.seen, event == START), jnp.array(False))
        watch, unclear = lax.cond(event >= 0, switched, begun)
        status = Status.where(rises, Status.running, chosen.status)
        return dataclasses.replace(
            contacts,
            mode=SwitchedMode(chosen.contacts, chosen.own, watch),
            kind=jnp.where(falls, EventKind.SWITCH, contacts.kind),
            detail=SwitchDetail(contacts.detail, jnp.where(falls, number, -1), mode.own),
            status=Status.where(unclear, Status.reset_unclear, status),
            at_once=self.fires_at_once(event, mode),
            silent=rises,
        )

    def _at_rest(self, number, t, after, chosen: Chosen, watch: Watch) -> Chosen:
        """The mode where an event has stopped what the scene compares, but for switch `number`: the force is another
        one then, and the contacts are chosen by it."""
        value, rate, scale = chosen.seen.value, chosen.seen.rate, chosen.seen.scale
        rests = jnp.abs(rate) <= closeness(rate.dtype) * watch.speed
        on_zero = rests & jnp.isfinite(scale) & (jnp.abs(value) <= rounding(value.dtype) * scale)
        q, v, _ = self.mechanics.split(after)
        scene: Any = as_written(self.mechanics.scene)
        own = scene._at_rest(number, t, q, v, chosen.own, on_zero)
        if own is None:
            return chosen

        def again():
            contacts = self.within(own).decide(jnp.array(FLOW_JUMP), t, after, chosen.contacts)
            status = Status.where(chosen.status == Status.running, contacts.status, chosen.status)
            return Chosen(own, contacts.mode, status, self._see(t, after, own, contacts.mode, watch))

        return lax.cond(same_mode(own, chosen.own), lambda: chosen, again)

    def _lift(self, t, x, chosen: Chosen, watch: Watch):
        """What is granted to switches that an event leaves on a zero that they lift off."""
        switches = lambda t, x: self._switches(t, x, chosen.own)
        flow = lambda t, x: self.within(chosen.own).flow(t, x, chosen.contacts)
        return watch.lift_off(switches, flow, (t, x), chosen.seen, tuple(map(number_of, self.mechanics.depth)))

    def _switch(self, number, t, x, before) -> tuple[Array, Any]:
        """The state and the mode after a switch has fallen."""
        q, v, z = self.mechanics.split(x)
        v, own = self.rules.switch(as_written(self.mechanics.scene), number, t, q, v, before)
        own = jax.tree.map(lambda new, old: lax.stop_gradient(jnp.asarray(new, old.dtype)), own, before)
        return jnp.concatenate([q, jnp.asarray(v, x.dtype), z]), own

    def reset(self, decision: Decision, t, x):
        """The switch acts on the velocities, then the impact does; only one of them does anything."""
        detail: SwitchDetail = decision.detail
        kicked = lambda: self._switch(detail.switch, t, x, detail.own)[0]
        x = lax.cond(detail.switch >= 0, kicked, lambda: x)
        return self.within(detail.own).reset(dataclasses.replace(decision, detail=detail.contacts), t, x)

    def silent_room(self, max_events):
        """A switch waits after it was passed, or from the start."""
        return max_events + self.switch_count

    def is_silent(self, event, mode: SwitchedMode):
        return mode.watch.is_silent(event - mode.contacts.active.shape[0])

    def fires_at_once(self, event, mode: SwitchedMode):
        return mode.watch.fires_at_once(event - mode.contacts.active.shape[0])

    def jump_times(self):
        return self.mechanics.jump_times()

    def events(self, states: EventStates, marks: EventMarks) -> Events:
        """Events as they are reported, with modes of the scene."""
        return reported_events(states, marks, self.mechanics.dof, own_mode(marks.mode.own))

    def ends_with(self, states, marks):
        scene = own_scene(self.mechanics.scene)
        return ends_with(self.mechanics.until, scene, lambda: self.events(states, marks))

    def projects(self, mode: SwitchedMode):
        return self.mechanics.projects(mode.contacts)

    def project(self, t, x, mode: SwitchedMode):
        return self.within(mode.own).project(t, x, mode.contacts)

    def project_with_error(self, t, x, mode: SwitchedMode):
        return self.within(mode.own).project_with_error(t, x, mode.contacts)

    def stuck(self, t, x, mode: SwitchedMode) -> Status:
        return self.within(mode.own).stuck(t, x, mode.contacts)

    def unconstrained(self, mode: SwitchedMode):
        """As of the contacts: while every one is open there is a shorter flow."""
        shorter = self.mechanics.unconstrained(mode.contacts)
        return None if shorter is None else (shorter[0], dataclasses.replace(self, mechanics=shorter[1]))
