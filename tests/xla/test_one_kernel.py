"""A motion and its gradient are one kernel each: packed arrays, a loop of one turn, and what is compiled of them."""

import re

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest

import hybridsens as hs
from hybridsens.xla.packed import pack
from hybridsens.xla.single_kernel import in_one_kernel
from tests.closeness import assert_close

LARGE = 10_000


def tree():
    """Leaves of every kind."""
    return {
        "real": jnp.array([[0.1, -0.2], [jnp.nan, jnp.inf]]),
        "single": jnp.array(1 / 3, jnp.float32),
        "whole": jnp.array([2**62, -(2**62) - 1]),
        "short": jnp.array([-7, 7], jnp.int32),
        "mask": jnp.array([True, False]),
        "unsigned": jnp.array([2**32 - 1], jnp.uint32),
        "complex": jnp.array(1 + 2j),
        "half": jnp.array(0.5, jnp.bfloat16),
        "key": jax.random.key(3),
        "nothing": jnp.zeros((0, 3)),
        "large": jnp.arange(LARGE * 1.0),
        "none": None,
    }


def assert_same(a, b):
    """The same PyTree to the last bit, types included."""
    assert jax.tree.structure(a) == jax.tree.structure(b)
    for one, other in zip(jax.tree.leaves(a), jax.tree.leaves(b), strict=True):
        assert one.dtype == other.dtype
        if jnp.issubdtype(one.dtype, jax.dtypes.prng_key):
            one, other = jax.random.key_data(one), jax.random.key_data(other)
        np.testing.assert_array_equal(one, other)


def test_packing_loses_nothing():
    packed = pack(tree())
    assert_same(packed.unpack(), tree())
    assert len(jax.tree.leaves(packed)) == 2 + 5  # a vector of each kind; unsigned, complex, half, key, large


@pytest.mark.parametrize("dtype", [bool, float])
def test_what_has_many_entries_stands_alone(dtype):
    """Truth values were counted as the bytes that they are, and packed as eight times as many."""
    assert [leaf.shape for leaf in pack([jnp.zeros((17, 100), dtype), jnp.zeros(2, dtype)]).separate] == [(17, 100)]


@pytest.mark.parametrize("size", [1, 50])
def test_a_function_in_one_kernel_returns_the_same(size):
    """Whether its results take more room than its arguments or less."""
    function = lambda tree, x: ({"more": jnp.sin(tree["real"][0]) * x, "turns": tree["whole"] + 1}, tree["large"] * 2)
    x = jnp.linspace(0, 1, size)[:, None]
    packed = jax.jit(in_one_kernel(function))(tree(), x)
    assert_same(packed.unpack(), jax.jit(function)(tree(), x))
    assert_same(packed, pack(packed.unpack()))  # with nothing left of the arguments' room


@pytest.mark.slow
@pytest.mark.parametrize("room", [300, 6_000, 30_000])
def test_forward_mode_agrees_with_the_kernel_whatever_the_room(room):
    """Records that are packed, records that stand alone, records too long for a kernel."""

    def height_at_the_end(height, adjoint):
        ball, start = hs.scenes.BouncingBall(height=height), hs.State(height[None], jnp.zeros(1))
        return hs.simulate(ball, start, t1=1.0, max_events=room, max_steps=room, adjoint=adjoint).final.q[0]

    height = jnp.array(1.0)
    forward = jax.jacfwd(height_at_the_end)(height, hs.ForwardSensitivities())
    assert_close(forward, jax.grad(height_at_the_end)(height, hs.Replay()), 1e-12)


def entry_of(compiled) -> str:
    """A compiled program, what it calls apart."""
    return compiled.as_text().split("ENTRY")[1]


def entry(function, *arguments) -> str:
    return entry_of(jax.jit(function).lower(*arguments).compile())


def kernels(function, *arguments) -> int:
    """How many kernels a compiled program starts, those inside of its loops apart."""
    names = re.findall(r"^\s+(?:ROOT )?%?[\w.\-]+ = .*? ([a-z\-]+)\(", entry(function, *arguments), re.MULTILINE)
    return sum(name not in {"get-tuple-element", "constant", "parameter", "bitcast", "tuple"} for name in names)


@pytest.mark.parametrize("scene", [hs.scenes.BouncingBall(), hs.scenes.ElasticStop()], ids=lambda s: type(s).__name__)
def test_a_gradient_starts_few_kernels(scene):
    """As a list of kernels it would be more than forty, most of which are there to begin the loops."""
    moving, fixed = eqx.partition(jax.tree.map(jnp.asarray, scene), eqx.is_inexact_array)

    def cost(moving):
        scene = eqx.combine(moving, fixed)
        return hs.simulate(scene, scene.initial_state(), t1=scene.t1, throw=False).final.q @ jnp.ones(1)

    assert kernels(jax.value_and_grad(cost), moving) < 20


@pytest.mark.slow
@pytest.mark.parametrize("count", [6, 10])
def test_many_contacts_leave_no_loop_outside_of_a_kernel(count):
    """Neither a product of matrices nor an entry that is picked among contacts keeps XLA from making one of all."""
    chain = hs.scenes.ChainOfMasses(count)

    def cost(scene):
        return hs.simulate(scene, scene.initial_state(), t1=scene.t1, throw=False).final.q @ jnp.ones(count)

    assert " while(" not in entry(jax.value_and_grad(cost), chain)


@pytest.mark.slow
def test_alone_and_in_a_batch_the_gradient_is_the_same():
    scene = hs.scenes.ElasticStop()
    cost = lambda d: hs.simulate(
        eqx.tree_at(lambda s: s.distance, scene, d), scene.initial_state(), t1=6.0, throw=False
    ).final.v[0]
    distances = jnp.array([0.5, 0.6, 0.7])
    one_by_one = jnp.stack([jax.jit(jax.grad(cost))(d) for d in distances])
    assert_close(jax.jit(jax.vmap(jax.grad(cost)))(distances), one_by_one, 1e-12)
