"""A scene whose functions are traced once, and say nothing twice.

Forces that follow from energies are derivatives of derivatives: three of four equations of their trace are there
already. All that is made from a trace (derivatives, bounds, and these again) would repeat them.
"""

from collections.abc import Callable

import equinox as eqx
import jax

from ..interval.repeats import without_repeats
from .scene import AbstractScene
from .wrapped import WrappedScene


class CondensedScene(WrappedScene):
    """A scene that answers by what the traces of its functions come down to."""

    programs: tuple[tuple[str, Callable], ...] = eqx.field(static=True)
    """(name, program) of each function that was condensed: (leaves of the scene, *arguments) -> result."""

    def mass_matrix(self, q):
        return self._asked("mass_matrix", q)

    def force(self, t, q, v):
        return self._asked("force", t, q, v)

    def _load(self, t, q, v):
        return self._asked("_load", t, q, v)

    def gap(self, t, q):
        return self._asked("gap", t, q)

    def _asked(self, name: str, *arguments):
        program = dict(self.programs).get(name)
        if program is None:
            return getattr(self.scene, name)(*arguments)
        return program(eqx.filter(self.scene, eqx.is_array), *arguments)


def condensed(scene: AbstractScene, t, q, v) -> AbstractScene:
    """The scene, with those of its functions condensed that repeat themselves."""
    leaves, rest = eqx.partition(scene, eqx.is_array)
    arguments = {"force": (t, q, v), "_load": (t, q, v), "gap": (t, q)}
    if isinstance(jax.eval_shape(scene.mass_matrix, q), jax.ShapeDtypeStruct):  # an operator knows more than its trace
        arguments["mass_matrix"] = (q,)
    ask = lambda name: lambda leaves, *given: getattr(eqx.combine(leaves, rest), name)(*given)
    found = ((name, without_repeats(ask(name), leaves, *given)) for name, given in arguments.items())
    programs = tuple((name, program) for name, program in found if program is not None)
    return CondensedScene(scene, programs) if programs else scene
