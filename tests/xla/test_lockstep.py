"""Batches whose elements run in step: the same motions, and no turn of a loop touches a whole record."""

import equinox.internal as eqxi
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from jax.extend.core import jaxprs_in_params

import hybridsens as hs
from hybridsens.xla import batches
from hybridsens.xla.lockstep import lockstep

ROOM = 64


def powers(x, until):
    """x, x**2, ... below `until`, in a record, and how many."""

    def turn(carried):
        record, last, count = carried
        return jax.lax.dynamic_update_slice(record, last[None], (count,)), last * x, count + 1

    start = jnp.zeros(ROOM), x, jnp.array(0)
    return eqxi.while_loop(lambda carried: carried[1] < until, turn, start, kind="lax", max_steps=None)


def selections(traced) -> list[tuple[int, ...]]:
    """Shapes of what is selected, in a trace and in those inside of it."""
    inside = [each for equation in traced.eqns for each in jaxprs_in_params(equation.params)]
    return [shape for each in inside for shape in selections(each)] + [
        equation.outvars[0].aval.shape for equation in traced.eqns if equation.primitive is jax.lax.select_n_p
    ]  # fmt: skip


@pytest.mark.parametrize("axes", [(0, 0), (0, None), (None, 0)])
def test_each_element_stops_by_itself(axes):
    """Assert that each has its own record, although the loop goes on until the last is done."""
    x, until = jnp.array([1.5, 4.0, 200.0]), jnp.array([100.0, 9.0, 50.0])
    x, until = (given if axis == 0 else given[0] for given, axis in zip((x, until), axes, strict=True))
    record, last, count = lockstep(powers, axes)(x, until)
    for place in range(3):
        alone = powers(*(given if axis is None else given[place] for given, axis in zip((x, until), axes, strict=True)))
        np.testing.assert_array_equal(record[place], alone[0])
        assert last[place] == alone[1] and count[place] == alone[2]


def test_a_row_is_selected_and_not_the_record():
    """Assert that JAX alone selects the record, so that the test can tell."""
    x = jnp.array([1.5, 4.0])
    of = lambda batch: selections(jax.make_jaxpr(batch)(x, x).jaxpr)
    assert (2, ROOM) in of(jax.vmap(powers)) and (2, ROOM) not in of(lockstep(powers, 0))


@pytest.mark.slow
@pytest.mark.parametrize("way", ["in step", "of JAX"])
def test_a_motion_selects_rows(way, monkeypatch):
    """Assert that of 70 steps one is selected at a time, as on a GPU."""
    jax.clear_caches()
    monkeypatch.setattr(jax, "default_backend", lambda: "gpu")
    if way == "of JAX":
        monkeypatch.setattr(batches, "lockstep", jax.vmap)
    ball = hs.scenes.BouncingBall()
    height = lambda h: hs.simulate(ball, hs.State(h[None], jnp.zeros(1)), t1=1.0, max_events=4, max_steps=70).final.q[0]
    found = selections(jax.make_jaxpr(jax.vmap(jax.grad(height)))(jnp.array([1.0, 0.4, 2.0])).jaxpr)
    assert any(shape[:2] == (3, 72) for shape in found) == (way == "of JAX")
    jax.clear_caches()
