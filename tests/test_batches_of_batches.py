"""Batches along several axes: of parameters, of weights of a cost, of entries of a result, of all of them at once."""

import jax
import jax.numpy as jnp
import pytest

import hybridsens as hs
from hybridsens.forward import short_record
from hybridsens.xla import batches
from tests.closeness import assert_close
from tests.problems.balls import RestlessBall

LANES = jnp.array([[1.0, 9.81, 0.8], [0.4, 9.81, 0.9], [6.0, 9.81, 0.8], [1.2, 8.0, 0.7]])
"""One, two, none, and one event."""
WEIGHTS = jnp.array([[1.0, 0.0], [0.3, -2.0], [0.0, 1.0]])


def end(p, adjoint=None):
    """Where a ball is at the end, and how fast, by p = (q0, g, e)."""
    start = hs.State(p[:1], jnp.zeros(1))
    settings = dict(rtol=1e-9, atol=1e-9, max_events=16, max_steps=400, adjoint=adjoint)
    final = hs.simulate(RestlessBall(p[1], p[2]), start, t1=1.0, **settings).final
    return jnp.concatenate([final.q, final.v])


def weighted(p, weights):
    return end(p) @ weights


jacobian = jax.jit(jax.jacrev(end))
gradients = jax.grad(weighted)
hessian = jax.jacfwd(jax.jacrev(end))
forward = lambda p: end(p, hs.ForwardSensitivities())
height = lambda p: end(p)[0]
total = lambda s: jnp.sum(jax.vmap(lambda p: height(s * p))(LANES))
"""Of all lanes, whose parameters are scaled alike."""


@pytest.fixture(scope="module")
def alone():
    """The Jacobian of every lane."""
    return jnp.stack([jacobian(p) for p in LANES])


@pytest.mark.parametrize(
    "mapped", [end, pytest.param(jax.jacrev(end), marks=pytest.mark.slow)], ids=["value", "gradient"]
)
def test_an_empty_batch_has_an_empty_result(mapped):
    """It was a division by zero."""
    alike = jax.eval_shape(mapped, LANES[0])
    assert jax.vmap(mapped)(LANES[:0]).shape == (0, *alike.shape)


def test_an_empty_batch_has_an_empty_jacobian_in_forward_mode():
    """It was a maximum over no directions."""
    assert jax.jacfwd(jax.vmap(forward))(LANES[:0]).size == 0


@pytest.mark.slow
def test_a_batch_of_jacobians(alone):
    """By rows: parameters and entries of the result are two axes."""
    assert_close(jax.jit(jax.vmap(jax.jacrev(end)))(LANES), alone, 1e-12)


@pytest.mark.slow
def test_a_jacobian_of_a_batch(alone):
    """Entries of the result are the outer axis here: of another lane's parameters a lane does not depend."""
    whole = jax.jit(jax.jacrev(jax.vmap(end)))(LANES)
    assert_close(jnp.stack([whole[lane, :, lane] for lane in range(4)]), alone, 1e-12)
    assert float(jnp.abs(whole[0, :, 1]).max()) == 0.0


@pytest.mark.slow
@pytest.mark.parametrize("weights_inside", [True, False])
def test_parameters_by_weights(alone, weights_inside):
    """A batch of parameters of a batch of weights, and the other way round."""
    if weights_inside:
        batch = jax.vmap(jax.vmap(gradients, (None, 0)), (0, None))(LANES, WEIGHTS)
    else:
        batch = jnp.swapaxes(jax.vmap(jax.vmap(gradients, (0, None)), (None, 0))(LANES, WEIGHTS), 0, 1)
    assert_close(batch, jnp.einsum("wi,lip->lwp", WEIGHTS, alone), 1e-12)


@pytest.mark.slow
def test_three_axes(alone):
    """Jacobians of a batch of batches."""
    batch = jax.vmap(jax.vmap(jax.jacrev(end)))(LANES.reshape(2, 2, 3))
    assert_close(batch.reshape(4, 2, 3), alone, 1e-12)


@pytest.fixture(scope="module")
def hessians():
    """Of the height of every lane, by all parameters."""
    compiled = jax.jit(jax.hessian(height))
    return jnp.stack([compiled(p) for p in LANES])


@pytest.mark.slow
def test_gradients_varied_by_what_only_the_cost_depends_on(alone):
    """Weights: the motions themselves do not vary. d(J^T w)/dw = J^T."""
    outside = jax.jacfwd(jax.vmap(gradients, (0, None)), 1)(LANES, WEIGHTS[1])
    assert_close(outside, jnp.swapaxes(alone, 1, 2), 1e-12)


@pytest.mark.slow
def test_a_batch_of_gradients_each_varied_by_weights(alone):
    inside = jax.vmap(jax.jacfwd(gradients, 1), (0, None))(LANES, WEIGHTS[1])
    assert_close(inside, jnp.swapaxes(alone, 1, 2), 1e-12)


@pytest.mark.slow
def test_a_batch_of_gradients_varied(hessians):
    """Forward mode outside of a batch."""
    batch = jax.jit(jax.vmap(jax.grad(height)))
    expected, ones = hessians.sum(-1), jnp.ones_like(LANES)
    assert_close(jax.jvp(batch, (LANES,), (ones,))[1], expected, 1e-10)
    assert_close(jax.linearize(batch, LANES)[1](ones), expected, 1e-10)


@pytest.mark.slow
def test_second_derivatives_of_a_batch(hessians):
    """By what all lanes share; of lanes in a batch; of lanes in a loop, whose derivative rules JAX takes apart."""
    shared = jnp.einsum("lij,li,lj->ij", hessians, LANES, LANES)
    assert_close(jax.hessian(total)(jnp.ones(3)), shared, 1e-10)
    assert_close(jax.vmap(jax.hessian(height))(LANES), hessians, 1e-10)
    looped = jax.hessian(lambda s: jnp.sum(jax.lax.map(lambda p: height(s * p), LANES)))
    assert_close(looped(jnp.ones(3)), shared, 1e-10)


@pytest.mark.slow
def test_forward_mode_in_batches(alone, hessians):
    """Jacobians of a batch; forward over forward through a batch, whose steps are others than those of the Hessians."""
    assert_close(jax.vmap(jax.jacfwd(forward))(LANES), alone, 1e-10)
    summed = lambda s: jnp.sum(jax.vmap(lambda p: forward(s * p)[0])(LANES))
    expected = jnp.einsum("lij,li,lj->ij", hessians, LANES, LANES)
    assert_close(jax.jacfwd(jax.jacfwd(summed))(jnp.ones(3)), expected, 1e-8)


@pytest.mark.slow
def test_a_batch_of_second_derivatives_of_several():
    """Forward over reverse, in a batch of parameters by entries of the result."""
    assert_close(jax.vmap(hessian)(LANES[:2]), jnp.stack([hessian(p) for p in LANES[:2]]), 1e-11)


@pytest.mark.slow
def test_where_all_lanes_run_at_once(alone, monkeypatch):
    """As on a GPU: reverse and forward mode (whose lanes share steps), and variations of a batch of gradients."""
    jax.clear_caches()
    monkeypatch.setattr(jax, "default_backend", lambda: "gpu")
    assert_close(jax.vmap(jax.jacrev(end))(LANES), alone, 1e-10)
    assert_close(jax.vmap(jax.jacfwd(forward))(LANES), alone, 1e-8)
    outside = jax.jacfwd(jax.vmap(gradients, (0, None)), 1)(LANES, WEIGHTS[1])
    assert_close(outside, jnp.swapaxes(alone, 1, 2), 1e-10)
    jax.clear_caches()


@pytest.mark.slow
@pytest.mark.parametrize("few", ["steps", "events", "bytes"])
def test_what_is_not_kept_is_run_again(alone, monkeypatch, few):
    """Records too long for some lanes, or for all, and for the room of a batch: the gradients stay the same."""
    jax.clear_caches()
    steps, events = (short_record, "_STEPS", 12), (short_record, "_EVENTS", 2)
    kept = dict(steps=steps, events=events, bytes=(batches, "_ROOM", 0))
    monkeypatch.setattr(*kept[few])
    assert_close(jax.vmap(jax.jacrev(end))(LANES), alone, 1e-12)
    jax.clear_caches()
