# %% [markdown]
# # A first bounce
#
# A ball falls from 1 m. **How high is it after 1.5 s, and how much would a livelier floor change that?**
#
# From nothing to a derivative that can be trusted, in five short steps.

# %%
import equinox as eqx
import jax
import jax.numpy as jnp
import matplotlib.pyplot as plt
import numpy as np

import hybridsens as hs

hs.configure()  # once, before the first array: double precision, fast programs

# %% [markdown]
# ## 1. A motion
#
# A *scene* says what moves. This one comes with the package: a height, a weight, a floor, and a coefficient of
# restitution (what part of the speed an impact gives back).

# %%
ball = hs.scenes.BouncingBall(height=1.0, restitution_coefficient=0.8)
motion = hs.simulate(ball, ball.initial_state(), t1=1.5, ts=jnp.linspace(0.0, 1.5, 301))
motion

# %% [markdown]
# Two impacts. Each is met exactly: the time of the first is that of a free fall from 1 m, to the last digits.

# %%
print(f"first impact  {motion.events.time[0]:.15f} s")
print(f"sqrt(2 h / g) {np.sqrt(2 / 9.81):.15f} s")

# %%
hs.plot_trajectory(ball, motion)

# %% [markdown]
# ## 2. A derivative
#
# The outcome is an ordinary function of the scene, and JAX differentiates it. The answer is a scene with a derivative
# in the place of every parameter.


# %%
def height_at_end(ball):
    return hs.simulate(ball, ball.initial_state(), t1=1.5).final.q[0]


value, slopes = jax.value_and_grad(height_at_end)(ball)
print(f"height at 1.5 s: {value:.6f} m")
for name in ("height", "velocity", "weight", "restitution_coefficient"):
    print(f"    by {name:<24} {getattr(slopes, name):+.6f}")

# %% [markdown]
# ## 3. Is it right?
#
# Between impacts the motion is a parabola, so here the height can be written down: fall for $t_1 = \sqrt{2h/g}$, rise
# and fall for $t_2 = 2 e t_1$, rise again with speed $e^2 g t_1$.


# %%
def by_hand(e, h=1.0, g=9.81, t=1.5):
    t1 = jnp.sqrt(2 * h / g)
    rest = t - t1 - 2 * e * t1
    return e**2 * g * t1 * rest - g * rest**2 / 2


exact = jax.grad(by_hand)(0.8)
print(f"by hand {exact:.12f}\nhere    {slopes.restitution_coefficient:.12f}")
assert abs(slopes.restitution_coefficient - exact) < 1e-7

# %% [markdown]
# ## 4. How far does a derivative reach?
#
# It is the slope of the outcome. Over a wide range of restitutions the outcome is no straight line, and where a floor
# is so dead that a third impact comes before 1.5 s, it has a kink: a derivative tells of one side of it.

# %%
many = jnp.linspace(0.45, 1.0, 241)
scenes = jax.vmap(lambda e: eqx.tree_at(lambda b: b.restitution_coefficient, ball, e))(many)
heights = jax.jit(jax.vmap(height_at_end))(scenes)
figure, axes = plt.subplots(figsize=(7, 4), layout="constrained")
axes.plot(many, heights, color="black", label="height at 1.5 s")
near = np.array([0.72, 0.88])
axes.plot(near, value + slopes.restitution_coefficient * (near - 0.8), "--", color="#c8553d", label="slope at 0.8")
axes.plot([0.8], [value], "o", color="#c8553d")
axes.set(xlabel="coefficient of restitution", ylabel="height [m]")
_ = axes.legend(frameon=False)

# %% [markdown]
# ## 5. The answer
#
# The ball is 0.40 m high, and 0.01 more restitution adds 2.6 cm. Next: why [differentiating through the impact
# naively](naive_gradients.ipynb) would have said something else.
