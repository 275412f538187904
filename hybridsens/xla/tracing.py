"""Tracing, a third of the time to compile, made short: what was traced is looked up, and no garbage is looked for."""

import contextlib
import gc
from collections.abc import Iterator

import equinox as eqx
import jax.numpy as jnp

from ..flat_system import AbstractFlatSystem


@contextlib.contextmanager
def collection_put_off() -> Iterator[None]:
    """Python collects no garbage inside, unless somebody else's code asks for it; afterwards all is as it was.

    A trace keeps nearly all that it makes. To look through it for garbage again and again takes a tenth of the time."""
    was_on = gc.isenabled()
    gc.disable()
    try:
        yield
    finally:
        if was_on:
            gc.enable()


class TracedOnce(AbstractFlatSystem):
    """The same system behind `jax.jit`, which keeps what it has traced and how it is differentiated."""

    system: AbstractFlatSystem

    def flow(self, t, x, mode):
        return _flow(self.system, t, x, mode)

    def guards(self, t, x, mode):
        return _guards(self.system, t, x, mode)

    def guards_and_rates(self, t, x, mode):
        return _guards_and_rates(self.system, t, x, mode)

    def searches(self, t, x):
        return self.system.searches(t, x)

    def search(self, step, mode, tolerance, wanted):
        return _search(self.system, step, mode, tolerance, wanted)

    def project(self, t, x, mode):
        return _project(self.system, t, x, mode)

    def jump_times(self):
        return self.system.jump_times()

    def scheduled_times(self, x, mode):
        return self.system.scheduled_times(x, mode)

    def expected(self, mode):
        return self.system.expected(mode)

    def silent_room(self, max_events):
        return self.system.silent_room(max_events)

    def is_silent(self, event, mode):
        return self.system.is_silent(event, mode)

    def fires_at_once(self, event, mode):
        return self.system.fires_at_once(event, mode)

    def projects(self, mode):
        return self.system.projects(mode)

    def project_with_error(self, t, x, mode):
        return _project_with_error(self.system, t, x, mode)

    def stuck(self, t, x, mode):
        return self.system.stuck(t, x, mode)

    def unconstrained(self, mode):
        found = self.system.unconstrained(mode)
        return None if found is None else (found[0], TracedOnce(found[1]))

    def scales(self, t, x, mode):
        return self.system.scales(t, x, mode)

    def grazing_depth(self, mode):
        return self.system.grazing_depth(mode)

    def decide(self, event, t, x, mode):
        return self.system.decide(event, t, x, mode)

    def choose(self, event, t, x, mode):
        return _choose(self.system, jnp.asarray(event, int), t, x, mode)  # of one type, to be one trace

    def reset(self, decision, t, x):
        return _reset(self.system, decision, t, x)


_flow = eqx.filter_jit(lambda system, t, x, mode: system.flow(t, x, mode))
_guards = eqx.filter_jit(lambda system, t, x, mode: system.guards(t, x, mode))
_guards_and_rates = eqx.filter_jit(lambda system, t, x, mode: system.guards_and_rates(t, x, mode))
_search = eqx.filter_jit(lambda system, *given: system.search(*given))
_project = eqx.filter_jit(lambda system, t, x, mode: system.project(t, x, mode))
_project_with_error = eqx.filter_jit(lambda system, t, x, mode: system.project_with_error(t, x, mode))
_choose = eqx.filter_jit(lambda system, event, t, x, mode: system.choose(event, t, x, mode))
_reset = eqx.filter_jit(lambda system, decision, t, x: system.reset(decision, t, x))
