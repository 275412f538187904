# %% [markdown]
# # What is wrong with differentiating through an impact naively
#
# A ball falls on a floor and bounces. Ask how the height at the end depends on where it started, how hard gravity pulls
# and how elastic the floor is. Automatic differentiation of the simulation answers at once, without a word of warning,
# and for most ways to write the simulation the answer is wrong.

# %%
import os

import hybridsens as hs

hs.configure()

import jax
import jax.numpy as jnp
import matplotlib.pyplot as plt
import numpy as np

from hybridsens.comparison.baselines import penalty_contact, where_reset
from hybridsens.scenes import ElasticStop

SMALL = bool(os.environ.get("HYBRIDSENS_NOTEBOOKS_SMALL"))  # fewer points, for a quick look

# %% [markdown]
# ## One impact by hand
#
# A ball falls from rest at height $q_0$ and hits the floor at $t_1 = \sqrt{2 q_0 / g}$ with speed $g t_1$. Shortly
# after, at time $t$, it is at
#
# $$q(t) = e\, g\, t_1 (t - t_1) - \tfrac12 g (t - t_1)^2 .$$
#
# Move the start up by a little: the ball arrives later. Its speed at impact changes, **and the impact happens at
# another time**. A simulation in fixed steps changes the speed at a step that is counted, not computed: for its
# derivative the time of impact is a constant.

# %%
g, e, t = 9.81, 0.8, 0.8


def height(q0):
    t1 = jnp.sqrt(2 * q0 / g)
    return e * g * t1 * (t - t1) - g * (t - t1) ** 2 / 2


def ball_in_steps(q0, steps):
    """Semi-implicit Euler with the reset in a `where`: what one writes first."""
    h = t / steps

    def step(k, state):
        q, v = state
        v = v - h * g
        q = q + h * v
        return q, jnp.where((q < 0) & (v < 0), -e * v, v)

    return jax.lax.fori_loop(0, steps, step, (q0, jnp.zeros_like(q0)))[0]


q0 = jnp.array(1.0)
exact = float(jax.grad(height)(q0))
print(f"height at t = {t}: {float(height(q0)):.6f}   exact derivative by q0: {exact:.6f}")
for steps in (100, 1_000, 10_000) if SMALL else (100, 1_000, 10_000, 100_000):
    value, slope = jax.value_and_grad(ball_in_steps)(q0, steps)
    print(f"{steps:>7} steps: height {float(value):.6f}   derivative {float(slope):.6f}")
one_bounce = (float(height(q0)), exact, float(slope))

# %% [markdown]
# The height converges. The derivative does not: it is 1 at any step size, because with the time of impact held constant
# a higher start simply stays a higher start. No smaller step will help: the error is not one of accuracy.
#
# What is missing is the change of the time of impact, $dt_1$, times the difference of velocities before and after:
#
# $$dx^+ = R_x\, dx^- + (R_x f^- - f^+)\, dt_1, \qquad dt_1 = -\frac{h_x\, dx^-}{h_x f^-} .$$
#
# ## A functional over several impacts
#
# The same on a forced oscillator that strikes an elastic stop five times, for $J = \int q^2 dt$ and all of its
# parameters. `cost` is written once; what moves the scene is given to it.

# %%
scene = ElasticStop()


def cost(scene, simulate):
    return simulate(scene, scene.initial_state(), t1=scene.t1, running_cost=lambda s, t, q, v: q @ q).cost


def gradient(simulate):
    slopes = jax.grad(lambda scene: cost(scene, simulate))(scene)
    return np.array(jax.tree.leaves(slopes), float)


@jax.jit
def ours(tolerance):
    simulate = lambda *arguments, **asked: hs.simulate(
        *arguments, **asked, rtol=tolerance, atol=tolerance, max_events=32, throw=False
    )
    return jnp.stack(jax.tree.leaves(jax.grad(lambda scene: cost(scene, simulate))(scene)))


reference = np.array(ours(jnp.array(1e-13)))


def error(found):
    return float(np.max(np.abs(found - reference)) / np.max(np.abs(reference)))


# %% [markdown]
# ## Gradient error against step size
#
# Three ways to move the scene: fixed steps with a `where`, springs instead of the contact (stiff ones: a contact lasts
# 1/500 of the horizon), and this package, whose average step is set by its tolerance.

# %%
COUNTS = (1_000, 4_000) if SMALL else (1_000, 3_000, 10_000, 30_000, 100_000)
TOLERANCES = (1e-4, 1e-8) if SMALL else (1e-4, 1e-5, 1e-6, 1e-7, 1e-8, 1e-9, 1e-10)


def fixed(simulate, steps):
    return jax.jit(lambda: jnp.asarray(jax.tree.leaves(jax.grad(
        lambda scene: cost(scene, lambda *given, **asked: simulate(*given, **asked, steps=steps))
    )(scene))))()  # fmt: skip


def steps_taken(tolerance):
    motion = hs.simulate(
        scene, scene.initial_state(), t1=scene.t1, running_cost=lambda s, t, q, v: q @ q,
        rtol=jnp.array(tolerance), atol=jnp.array(tolerance), max_events=32, throw=False,
    )  # fmt: skip
    return int(motion.steps.accepted)


errors = {
    "`where` reset": [(scene.t1 / n, error(fixed(where_reset, n))) for n in COUNTS],
    "penalty contact": [(scene.t1 / n, error(fixed(penalty_contact, n))) for n in COUNTS],
    "hybridsens": [(scene.t1 / steps_taken(tol), error(ours(jnp.array(tol)))) for tol in TOLERANCES],
}
for name, points in errors.items():
    print(name, *(f"h = {h:.1e}: {wrong:.1e}" for h, wrong in points), sep="\n    ")

# %%
figure, axes = plt.subplots(figsize=(7, 4.5), layout="constrained")
for (name, points), style in zip(errors.items(), ("s--", "D:", "o-"), strict=True):
    axes.loglog(*zip(*points, strict=True), style, color="black", label=name, markersize=5, linewidth=1)
axes.set(xlabel="(average) step [s]", ylabel="relative error of the gradient", title="elastic stop, five impacts")
axes.grid(color="0.9")
_ = axes.legend()

# %% [markdown]
# The upper two lines do not fall, however small the step. The `where` reset differentiates another function than the
# one it computes. The springs have the right derivative of the wrong model: only stiffer springs would help here, and
# they need smaller steps still (with a damper they do not help at all: the force then jumps where contact begins, and
# the derivative of that jump is left out too). The lower line falls with the step, as a gradient should.
#
# `hybridsens compare elastic-stop` shows the same for more methods, with times and memory.
