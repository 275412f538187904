# %% [markdown]
# # A layer of neurons learns when to fire
#
# A neuron's voltage leaks, input spikes push it up, and where it reaches a threshold it fires and starts again from 0.
# What it says is *when* it fires. **Can weights be learned by gradient descent such that three neurons fire first at
# times that we choose?** A spike is an event, and its time is differentiable.

# %%
import os

import equinox as eqx
import jax
import jax.numpy as jnp
import matplotlib.pyplot as plt
import numpy as np
import optax

import hybridsens as hs

hs.configure()

SMALL = bool(os.environ.get("HYBRIDSENS_NOTEBOOKS_SMALL"))  # fewer iterations, for a quick check that all runs

# %% [markdown]
# Four input spikes, three neurons that do not hear each other, weights at random, and the times that are wanted.

# %%
inputs = jnp.array([0.5, 1.0, 2.0, 3.0])
wanted = jnp.array([2.6, 1.7, 3.4])
start = jnp.array(np.random.default_rng(0).uniform(1.0, 1.6, (3, 4)))
layer = hs.systems.Neurons(jnp.zeros((3, 3)), start, inputs, jnp.zeros(3))


def run(weights, ts=None):
    made = eqx.tree_at(lambda n: n.input_weights, layer, weights)
    return hs.solve(made, made.initial_state(), t1=8.0, ts=ts, max_events=32)


def first_spikes(weights):
    events = run(weights).events
    own = events.guard[:, None] == jnp.arange(3)
    return jnp.min(jnp.where(own, events.time[:, None], jnp.inf), axis=0)


def loss(weights):
    return jnp.mean((first_spikes(weights) - wanted) ** 2)


print("first spikes before learning:", first_spikes(start).round(3), " wanted:", wanted)

# %% [markdown]
# ## One derivative, checked
#
# How does the first spike of the first neuron move with its weight for the second input? The voltage at the spike does
# not change (it is the threshold), so $dt/dw = -(\partial v/\partial w) / v'$; this is what the gradient of an event's
# time is. Two runs with slightly different weights say the same.

# %%
slope = jax.grad(lambda w: first_spikes(w)[0])(start)
nudge = jnp.zeros((3, 4)).at[0, 1].set(1e-6)
difference = (first_spikes(start + nudge)[0] - first_spikes(start - nudge)[0]) / 2e-6
print(f"gradient {slope[0, 1]:.8f} ms, differences {difference:.8f} ms; by weights of other neurons {slope[1:].sum()}")
assert abs(slope[0, 1] - difference) < 1e-6

# %% [markdown]
# ## Learning
#
# Plain Adam on the squared error of the times.

# %%
rule = optax.adam(0.03)


@jax.jit
def step(weights, memory):
    value, gradient = jax.value_and_grad(loss)(weights)
    change, memory = rule.update(gradient, memory)
    return weights + change, memory, value


weights, memory, losses = start, rule.init(start), []
for _ in range(40 if SMALL else 200):
    weights, memory, value = step(weights, memory)
    losses.append(float(value))
print(f"loss {losses[0]:.3f} -> {losses[-1]:.1e} ms^2")
print("first spikes after learning:", first_spikes(weights).round(4))
assert losses[-1] < (0.1 * losses[0] if SMALL else 1e-5)

# %%
ts = jnp.linspace(0.0, 8.0, 801)
figure, panels = plt.subplots(4, 1, figsize=(8, 6.5), layout="constrained", sharex=False)
before, after = run(start, ts), run(weights, ts)
for k, axes in enumerate(panels[:3]):
    axes.plot(ts, before.x["v"][:, k], color="0.65", label="before")
    axes.plot(ts, after.x["v"][:, k], color="black", label="after")
    axes.axvline(wanted[k], color="#c8553d", linewidth=4, alpha=0.4, label="wanted")
    axes.set(ylabel=f"neuron {k}", xlim=(0, 8))
panels[0].legend(ncols=3, frameon=False, loc="lower right", bbox_to_anchor=(1, 1))
panels[2].set_xlabel("time [ms]")
panels[3].semilogy(losses, color="black")
_ = panels[3].set(xlabel="iteration", ylabel="loss [ms$^2$]")

# %% [markdown]
# ## The answer
#
# Yes, in some dozen iterations, and the gradient is that of the exact spike times, not of a smoothed stand-in. Where
# it ends: a spike that is not there has no time, and no derivative that could bring it about. Start from weights with
# which the neurons fire.
