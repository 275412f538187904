# %% [markdown]
# # Where gradients stop making sense
#
# The derivatives of this package are those of the exact motion. **When is such a derivative right and still of no
# use?** Three cases, and how to notice them.

# %%
import os

import jax
import jax.numpy as jnp
import matplotlib.pyplot as plt
import numpy as np

import hybridsens as hs

hs.configure()

SMALL = bool(os.environ.get("HYBRIDSENS_NOTEBOOKS_SMALL"))  # fewer points, for a quick check that all runs
POINTS = 41 if SMALL else 401

# %% [markdown]
# ## Grazing
#
# An oscillator swings towards a stop. Move the stop away until it is only just touched: the closing speed of that
# impact goes to zero, and the derivative of where the oscillator is at 8 s goes to infinity, as one over that speed.
# Beyond, the impact is gone.


# %%
def swing(distance):
    scene = hs.scenes.ElasticStop(distance=distance)
    motion = hs.simulate(scene, scene.initial_state(), t1=8.0, throw=False, max_events=16)
    happened = jnp.arange(16) < motion.events.count
    slowest = jnp.min(jnp.where(happened, motion.events.closing_speed, jnp.inf))
    return motion.final.q[0], (motion.events.count, slowest)


distances = jnp.linspace(0.3, 2.6, POINTS)
(ends, (counts, speeds)), slopes = jax.jit(jax.vmap(jax.value_and_grad(swing, has_aux=True)))(distances)
figure, panels = plt.subplots(3, 1, figsize=(7, 6.5), sharex=True, layout="constrained")
panels[0].plot(distances, ends, ".", color="black", markersize=2)
panels[0].set_ylabel("place at 8 s [m]")
panels[1].semilogy(distances, np.abs(slopes), ".", color="black", markersize=2)
panels[1].set_ylabel("|derivative|")
panels[2].plot(distances, speeds, ".", color="black", markersize=2)
panels[2].set(ylabel="closing speed of the\nslowest impact [m/s]", xlabel="distance of the stop [m]")
for edge in distances[1:][np.diff(counts) != 0]:
    for axes in panels:
        axes.axvline(edge, color="0.8", zorder=0)

# %% [markdown]
# Grey lines are where the number of impacts changes. On one side of each, the closing speed of one impact falls to
# zero, and the derivative grows without bound, over a wide range at the right line and a narrow one at the left.
# Across it the outcome has a kink. **How to notice:** `motion.events.closing_speed`, and the status `grazing` where
# the tolerance cannot tell touch from miss.
#
# ## Another sequence of events
#
# Between the lines the derivative is the slope of the curve, and across a line it knows nothing of the other side. A
# descent that steps over it finds another slope there. **How to notice:** `motion.events.count` and `.kind` before and
# after a step; `fit` tells of such steps, and `sweep` draws the borders.
#
# ## Chaos
#
# The same oscillator with a nearer stop: each impact magnifies small differences. `lyapunov` says how fast they grow.

# %%
scene = hs.scenes.ElasticStop(distance=0.1, damping=0.02, frequency=2.6)
horizons = (5.0, 20.0) if SMALL else (5.0, 10.0, 20.0, 40.0, 80.0, 120.0, 160.0)
settings = dict(rtol=1e-10, atol=1e-10, max_steps=32768, max_events=512)
found = [hs.lyapunov(scene, scene.initial_state(), t1=t1, **settings) for t1 in horizons]
for t1, growth in zip(horizons, found, strict=True):
    impacts = int(growth.trajectory.events.count)
    print(f"until {t1:5.0f} s: {impacts:>3} impacts, a variation grows {growth.growth:9.2e} times")

# %% [markdown]
# A derivative that large is right and useless: it describes parameters that differ by less than its inverse. Over the
# smallest step that an optimiser takes, the outcome goes up and down many times.


# %%
def at_end(amplitude, t1):
    driven = hs.scenes.ElasticStop(distance=0.1, damping=0.02, frequency=2.6, amplitude=amplitude)
    return hs.simulate(driven, driven.initial_state(), t1=t1, throw=False, max_events=256, max_steps=8192).final.q[0]


amplitudes = jnp.linspace(0.95, 1.05, POINTS)
figure, panels = plt.subplots(1, 2, figsize=(9, 3.4), layout="constrained")
run = jax.jit(jax.vmap(at_end, in_axes=(0, None)))
for axes, t1 in zip(panels, (horizons[0], horizons[-1]), strict=True):
    axes.plot(amplitudes, run(amplitudes, t1), color="black", linewidth=1)
    axes.set(title=f"place at {t1:.0f} s [m]", xlabel="amplitude of the drive [N]")

# %% [markdown]
# **How to notice:** `lyapunov`, or a gradient many orders of magnitude above (outcome / parameter). **What to do:**
# shorter horizons, a fit that grows its horizon (`GrowingHorizon`), or averages over a sweep instead of a gradient.
#
# ## The answer
#
# Derivatives end to be of use at grazing, across a change of the sequence of events, and after many impacts that
# magnify differences. None of this is an error of the method, and each leaves a mark that can be read: closing speeds,
# events, growth.
