"""A scene each of whose comparisons is a switch: what jumps or has a kink there is a mode."""

from collections.abc import Callable
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
from jax import lax

from ..located.comparisons import Comparisons
from ..located.system import LocatedMode
from ..validation.arguments import in_type
from .checks import check_shapes
from .scene import AbstractScene, State
from .switches import AbstractSwitchedScene, check_mode, check_switches, in_mode
from .wrapped import as_written


class LocatedScene(AbstractSwitchedScene):
    """A scene whose comparisons of (t, q, v) in force, gap, switches and running cost keep their outcomes in a mode.

    Switches 0, 1, ... are those of the scene, those of the comparisons follow. The mass matrix is left as it is."""

    scene: AbstractScene
    running_cost: Callable[..., Any] | None
    """Of the scene as the user wrote it."""
    own_switches: int = eqx.field(static=True)
    """Switches of the user's scene."""

    @property
    def sustained_contact(self):  # type: ignore[override]
        return self.scene.sustained_contact

    @property
    def known_discontinuities(self):  # type: ignore[override]
        return self.scene.known_discontinuities

    def begin(self, t, q, v, own) -> LocatedMode:
        """The mode in which a motion from (t, q, v) begins."""
        return LocatedMode(own, self._comparisons(t, q, v, own).outcomes())

    def mass_matrix(self, q):
        return self.scene.mass_matrix(q)

    def restitution(self):
        return self.scene.restitution()

    def gap(self, t, q):
        return self.scene.gap(t, q)

    def force(self, t, q, v, mode: LocatedMode):
        return self._comparisons(t, q, v, mode.own).held(0, mode.outcomes)

    def _gap_in(self, t, q, mode: LocatedMode):
        return self._comparisons(t, q, jnp.zeros_like(q), mode.own).held(1, mode.outcomes)

    def switches(self, t, q, v, mode: LocatedMode):
        compared = self._comparisons(t, q, v, mode.own)
        return jnp.concatenate([compared.held(2, mode.outcomes), compared.guards(mode.outcomes)])

    def cost(self, t, q, v, mode: LocatedMode):
        """Running cost."""
        return self._comparisons(t, q, v, mode.own).held(3, mode.outcomes)

    def switch(self, event, t, q, v, mode: LocatedMode):
        """That of the scene; or an outcome changes, and nothing else. One that a jump of v changes comes at once."""
        number = event - self.own_switches
        v, own = lax.cond(number >= 0, lambda: (v, mode.own), lambda: self._own_switch(event, t, q, v, mode.own))
        outcomes = self._comparisons(*lax.stop_gradient((t, q, v)), own).after(number, mode.outcomes)
        return v, LocatedMode(own, outcomes)

    def _at_rest(self, event, t, q, v, mode: LocatedMode, on_zero) -> LocatedMode:
        """An impact, or a switch of the scene, may stop what is compared on the very number that it is compared with:
        its outcome is then that of two equal numbers."""
        compared = self._comparisons(*lax.stop_gradient((t, q, v)), mode.own)
        outcomes = compared.stopped(event - self.own_switches, mode.outcomes, on_zero[self.own_switches :])
        return LocatedMode(mode.own, outcomes)

    def _own_switch(self, event, t, q, v, own):
        if not isinstance(self.scene, AbstractSwitchedScene):
            return v, own
        after, changed = self.scene.switch(event, t, q, v, own)
        return jnp.asarray(after, v.dtype), jax.tree.map(lambda new, old: jnp.asarray(new, old.dtype), changed, own)

    def _comparisons(self, t, q, v, own) -> Comparisons:
        scene, cost = self.scene, self.running_cost

        def functions(t, q, v, own):
            if isinstance(scene, AbstractSwitchedScene):
                given, switches = (t, q, v, own), scene.switches(t, q, v, own)
            else:
                given, switches = (t, q, v), jnp.zeros(0, q.dtype)
            force, gap = scene.force(*given), scene.gap(t, q)
            return force, gap, switches, None if cost is None else cost(scene, *given)

        return Comparisons(functions, (t, q, v), own)


def located(scene: AbstractScene, running_cost: Callable | None, t, state: State, mode: Any):
    """The scene with its comparisons as switches, its running cost and its first mode; all as they were where nothing
    is compared. What is given is checked as it was written."""
    check_mode(scene, mode)
    count = check_switches(scene, state, mode) if isinstance(scene, AbstractSwitchedScene) else 0
    in_its_mode, cost_there = in_mode(scene, running_cost, mode)
    check_shapes(in_its_mode, state, cost_there)
    of_one_type: tuple[AbstractScene, Callable | None] = in_type((scene, running_cost), state.q.dtype)
    made = LocatedScene(*of_one_type, count)
    first = made.begin(t, state.q, state.v, mode)
    if first.outcomes.guard_count == 0:
        return scene, running_cost, mode
    return made, None if running_cost is None else _cost, first


def own_scene(scene: AbstractScene) -> AbstractScene:
    """The scene that the user wrote, also where its comparisons are held."""
    scene = as_written(scene)
    return scene.scene if isinstance(scene, LocatedScene) else scene


def _cost(scene: LocatedScene, t, q, v, mode: LocatedMode):
    return scene.cost(t, q, v, mode)
