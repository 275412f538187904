"""What was traced is looked up again, and no garbage is looked for meanwhile."""

import gc
import inspect

import pytest

from hybridsens.flat_system import AbstractFlatSystem
from hybridsens.xla.tracing import TracedOnce, collection_put_off


def test_collection_is_put_off_and_comes_back():
    assert gc.isenabled()
    with collection_put_off():
        assert not gc.isenabled()
        with collection_put_off():
            pass
        assert not gc.isenabled()
    assert gc.isenabled()


def test_collection_comes_back_where_a_trace_fails():
    with pytest.raises(ZeroDivisionError), collection_put_off():
        1 / 0  # noqa: B018
    assert gc.isenabled()


def test_who_has_switched_collection_off_keeps_it_off():
    gc.disable()
    try:
        with collection_put_off():
            pass
        assert not gc.isenabled()
    finally:
        gc.enable()


def test_every_method_is_handed_on():
    """One that is not would be answered by the default, in silence."""
    methods = {name for name, _ in inspect.getmembers(AbstractFlatSystem, inspect.isfunction) if name[0] != "_"}
    assert len(methods) > 15
    assert methods <= set(vars(TracedOnce))
