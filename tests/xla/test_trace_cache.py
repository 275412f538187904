"""A system behind its traces is asked everything that the system itself is."""

import inspect

from hybridsens.flat_system import AbstractFlatSystem
from hybridsens.xla.trace_cache import TracedOnce


def test_every_method_is_handed_on():
    """One that is not would be answered by the default, in silence."""
    methods = {name for name, _ in inspect.getmembers(AbstractFlatSystem, inspect.isfunction) if name[0] != "_"}
    assert len(methods) > 15
    assert methods <= set(vars(TracedOnce))
