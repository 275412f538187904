"""A layer of neurons learns when to fire, by the gradient of its spike times by its weights."""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import optax

import hybridsens as hs


def test_a_layer_learns_its_spike_times():
    """Three neurons hear four inputs; the first spike of each is to come at a time of its own."""
    inputs = jnp.array([0.5, 1.0, 2.0, 3.0])
    start = jnp.array(np.random.default_rng(0).uniform(1.0, 1.6, (3, 4)))
    layer = hs.systems.Neurons(jnp.zeros((3, 3)), start, inputs, jnp.zeros(3))
    wanted = jnp.array([2.6, 1.7, 3.4])

    def first_spikes(weights):
        made = hs.solve(
            eqx.tree_at(lambda n: n.input_weights, layer, weights), layer.initial_state(), t1=8.0, max_events=32
        ).events
        own = made.guard[:, None] == jnp.arange(3)
        return jnp.min(jnp.where(own, made.time[:, None], jnp.inf), axis=0)

    def loss(weights):
        return jnp.mean((first_spikes(weights) - wanted) ** 2)

    rule = optax.adam(0.03)

    @jax.jit
    def step(weights, memory):
        value, gradient = jax.value_and_grad(loss)(weights)
        change, memory = rule.update(gradient, memory)
        return weights + change, memory, value

    weights, memory, losses = start, rule.init(start), []
    for _ in range(150):
        weights, memory, value = step(weights, memory)
        losses.append(float(value))
    assert losses[0] > 0.1
    assert losses[-1] < 1e-5
