"""What was traced is looked up again, and no garbage is looked for meanwhile."""

import gc
import inspect

import jax
import jax.numpy as jnp
import pytest

import hybridsens as hs
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


class Decay(hs.AbstractHybridSystem):
    """x' = -rate x, and nothing happens. It counts how often it is traced."""

    rate: jax.Array
    traced = 0

    def flow(self, t, x, mode):
        type(self).traced += 1
        return -self.rate * x

    def guards(self, t, x, mode):
        return jnp.zeros(0)

    def transition(self, event, t, x, mode):
        return x, mode


def test_a_parameter_of_a_weak_type_is_traced_no_oftener():
    """`jnp.array(1.0)` has one, and an array that was computed has none."""
    weak, strong = jnp.array(1.0), jnp.ones(())
    assert weak.weak_type and not strong.weak_type
    traced = []
    for rate in (weak, strong):
        counting = type("Counting", (Decay,), {})
        jax.make_jaxpr(lambda rate, kind=counting: hs.solve(kind(rate), 1.0, t1=1.0).final)(rate)
        traced.append(counting.traced)
    assert traced[0] == traced[1]
