"""Garbage is collected again after a trace, also one that failed."""

import gc

import pytest

from hybridsens.xla.collection import collection_put_off


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
