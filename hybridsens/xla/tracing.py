"""Tracing, a third of the time to compile, made short: what was traced is kept, and no garbage is collected."""

import contextlib
import gc
from collections.abc import Iterator
from typing import Any

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


def _asked(name: str) -> Any:
    """A method that asks the system."""
    return lambda self, *given: getattr(self.system, name)(*given)


def _kept(name: str) -> Any:
    """A method that asks the system, behind `jax.jit`."""
    ask = eqx.filter_jit(lambda system, *given: getattr(system, name)(*given))
    return lambda self, *given: ask(self.system, *given)


_decide = eqx.filter_jit(lambda system, *given: system.decide(*given))


class TracedOnce(AbstractFlatSystem):
    """The same system behind `jax.jit`, which keeps what it has traced and how it is differentiated."""

    system: AbstractFlatSystem

    flow = _kept("flow")
    guards = _kept("guards")
    guards_and_rates = _kept("guards_and_rates")
    search = _kept("search")
    project = _kept("project")
    project_with_error = _kept("project_with_error")
    reset = _kept("reset")

    # What is short, or asked while a program is traced:
    searches = _asked("searches")
    projects = _asked("projects")
    jump_times = _asked("jump_times")
    scheduled_times = _asked("scheduled_times")
    expected = _asked("expected")
    silent_room = _asked("silent_room")
    is_silent = _asked("is_silent")
    fires_at_once = _asked("fires_at_once")
    ends_with = _asked("ends_with")
    stuck = _asked("stuck")
    scales = _asked("scales")
    clock_scales = _asked("clock_scales")
    turning_scales = _asked("turning_scales")
    grazing_depth = _asked("grazing_depth")

    def decide(self, event, t, x, mode):
        return _decide(self.system, jnp.asarray(event, int), t, x, mode)  # of one type, to be one trace

    def unconstrained(self, mode):
        found = self.system.unconstrained(mode)
        return None if found is None else (found[0], TracedOnce(found[1]))
