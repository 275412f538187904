# %% [markdown]
# # Parameter maps of an impact oscillator
#
# A forced oscillator strikes a stop. How does a cost of its motion depend on the forcing, where is its gradient large,
# and where does the sequence of impacts change? Then: which motions does it settle to?

# %%
import os

import hybridsens

hybridsens.configure(host_devices=os.cpu_count())  # a sweep uses every device, and a CPU shows as many as it is told to

import jax.numpy as jnp
import numpy as np

from hybridsens.scenes import ElasticStop
from hybridsens.sweeps import grid, plot_bifurcation, plot_sweep, status_counts, sweep

SMALL = bool(os.environ.get("HYBRIDSENS_NOTEBOOKS_SMALL"))  # coarse maps, for a quick check that everything runs
POINTS, FREQUENCIES, PERIODS = (12, 10, 40) if SMALL else (200, 600, 200)

# %% [markdown]
# ## Value and gradient over two parameters
#
# The cost returns its value and the motion, so that the sweep can tell of events and of points that fail. Every point
# gets the derivative of J by every parameter of the scene.


# %%
def running_cost(scene, t, q, v):
    return q @ q


def cost(scene):
    trajectory = hybridsens.simulate(
        scene, scene.initial_state(), t1=20.0, running_cost=running_cost, max_events=32, max_steps=512, throw=False
    )
    return trajectory.cost, trajectory


design = grid(ElasticStop(), {"amplitude": np.linspace(0.5, 1.5, POINTS), "frequency": np.linspace(1.0, 2.0, POINTS)})
units = {"amplitude": "N", "frequency": "rad/s", "J": "m2 s"}
dataset = sweep(cost, design, units=units, progress=False)
dataset

# %% [markdown]
# Lines separate different sequences of impacts. Along them a motion grazes the stop: J has a kink there, and the
# gradient beside the line can be arbitrarily large. `grazing_margin` tells how far from such a line a point is.

# %%
plot_sweep(dataset)

# %%
assert status_counts(dataset) == {"successful": POINTS**2}
assert len(np.unique(dataset.event_sequence)) >= 4, "the map should cross several borders"

# %% [markdown]
# ## Bifurcation diagram
#
# An inelastic stop, seen once a period of the forcing after the motion has settled. One point over a frequency: the
# motion repeats each period; n points: after n periods; a cloud: never.


# %%
def once_a_period(scene):
    period = 2 * jnp.pi / scene.frequency
    ts = period * jnp.arange(PERIODS // 2, PERIODS)
    trajectory = hybridsens.simulate(
        scene, scene.initial_state(), t1=PERIODS * period, ts=ts, rtol=1e-7, atol=1e-7,
        max_events=10 * PERIODS, max_steps=100 * PERIODS, throw=False,
    )  # fmt: skip
    return trajectory.final.q[0], trajectory


class StickyStop(ElasticStop):
    """An inelastic stop on which the mass may come to rest for a while, after ever smaller impacts."""

    sustained_contact = True


stop = StickyStop(distance=0.1, restitution_coefficient=0.8, damping=0.02)
sweep_design = grid(stop, {"frequency": np.linspace(2.2, 3.2, FREQUENCIES)})
settled = sweep(once_a_period, sweep_design, gradient=False, states=True, events=0, units=units, progress=False)
plot_bifurcation(settled, state="v")

# %%
statuses = status_counts(settled)
assert statuses["successful"] > 0.95 * FREQUENCIES
statuses
