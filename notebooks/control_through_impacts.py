# %% [markdown]
# # Optimal control through impacts: a cart with a pendulum between two bumpers
#
# A cart carries a hanging load to and fro on a short track with a bumper at either end. It passes a mark to the right
# at 1 m/s, and 1.8 s later must pass the same mark to the left at the same speed. **Which force of its motor does that
# with the least effort: should it brake and turn round by itself, or run into the bumper?**

# %%
import os

import equinox as eqx
import jax
import jax.numpy as jnp
import matplotlib.pyplot as plt
import optax
from jax import Array

import hybridsens as hs

hs.configure()

SMALL = bool(os.environ.get("HYBRIDSENS_NOTEBOOKS_SMALL"))  # fewer iterations, for a quick check that all runs
ITERATIONS = 30 if SMALL else 800

# %% [markdown]
# ## The machine
#
# Energies of cart and pendulum; the force of the motor is a straight line between *knots*, and its values there are
# parameters like any other. `jump_times` declares the knots, so that steps end at them.


# %%
class CartPole(hs.LagrangianScene):
    """A cart with a hanging pendulum between bumpers at -0.5 m and 0.5 m."""

    knots: Array  # of the force [s]
    force_values: Array  # [N]

    sustained_contact = False
    coordinates = ("cart [m]", "angle [rad]")
    contacts = ("left bumper", "right bumper")

    def bob(self, q):
        return jnp.stack([q[0] + 0.5 * jnp.sin(q[1]), -0.5 * jnp.cos(q[1])])

    def kinetic_energy(self, q, v):
        speed = hs.planar.velocity(self.bob, q, v)
        return 0.5 * 1.0 * v[0] ** 2 + 0.5 * 0.3 * speed @ speed

    def potential_energy(self, q):
        return 0.3 * 9.81 * self.bob(q)[1]

    def applied_force(self, t, q, v):
        return jnp.stack([jnp.interp(t, self.knots, self.force_values), 0.0 * t])

    def gap(self, t, q):
        return jnp.stack([q[0] + 0.5, 0.5 - q[0]])

    def restitution(self):
        return jnp.array([0.7, 0.7])

    def jump_times(self):
        return self.knots

    def draw(self, q):
        bob, x = self.bob(q), q[0]
        box = jnp.array([[-0.1, 0.0], [0.1, 0.0], [0.1, 0.1], [-0.1, 0.1], [-0.1, 0.0]])
        bumpers = [jnp.array([[side * 0.6, -0.05], [side * 0.6, 0.15]]) for side in (-1, 1)]
        return [box + jnp.stack([x, 0.0 * x]), jnp.stack([jnp.stack([x, 0.0 * x]), bob]), hs.planar.circle(bob, 0.04),
                *bumpers]  # fmt: skip


# %% [markdown]
# ## The cost
#
# The mark is at -0.3 m, and the load hangs still at first. Effort is the mean square of the force, and $J$ = effort +
# 100 (distance from the wanted place and speed)$^2$.

# %%
T = 1.8
knots = jnp.linspace(0.0, T, 10)
start = hs.State([-0.3, 0.0], [1.0, 0.0])


def cost(values):
    end = hs.simulate(CartPole(knots, values), start, t1=T, max_events=16).final
    miss = (end.q[0] + 0.3) ** 2 + (end.v[0] + 1.0) ** 2
    effort = jnp.mean(values**2)
    return effort + 100 * miss, (effort, miss)


# %% [markdown]
# ## Descent
#
# Adam, from two guesses: a steady push backward that turns the cart round, and no force at all, which lets it run into
# the bumper. A gradient follows each motion with the impacts that it has.

# %%
rule = optax.adam(optax.cosine_decay_schedule(0.2, ITERATIONS))


@eqx.filter_jit
def step(values, memory):
    (value, parts), gradient = jax.value_and_grad(cost, has_aux=True)(values)
    change, memory = rule.update(gradient, memory)
    return values + change, memory, value, parts


def descend(values):
    memory, history = rule.init(values), []
    for _ in range(ITERATIONS):
        values, memory, value, parts = step(values, memory)
        history.append(float(value))
    return values, history, [float(part) for part in parts]


guesses = {"by motor": jnp.full(10, -1.5), "by bumper": jnp.zeros(10)}
found = {name: descend(guess) for name, guess in guesses.items()}
ts = jnp.linspace(0.0, T, 401)
motions = {name: hs.simulate(CartPole(knots, values), start, t1=T, ts=ts) for name, (values, *_) in found.items()}
for name, (_, history, (effort, miss)) in found.items():
    impacts = int(motions[name].events.count)
    print(f"{name}: J {history[0]:.1f} -> {history[-1]:.3f}; effort {effort:.3f} N^2, misses by {miss**0.5:.4f}, "
          f"{impacts} impacts")  # fmt: skip

# %%
figure, panels = plt.subplots(2, 2, figsize=(9, 5), layout="constrained")
for (name, (values, history, _)), style in zip(found.items(), ("-", "--"), strict=True):
    motion, shown = motions[name], dict(color="black" if style == "-" else "#c8553d", linestyle=style)
    panels[0, 0].plot(knots, values, label=name, **shown)
    panels[0, 1].semilogy(history, **shown)
    panels[1, 0].plot(ts, motion.q[:, 0], **shown)
    panels[1, 1].plot(ts, motion.q[:, 1], **shown)
panels[1, 0].axhspan(0.5, 0.56, color="0.85")
panels[1, 0].axhspan(-0.56, -0.5, color="0.85")
panels[0, 0].set(ylabel="force [N]", xlabel="time [s]")
panels[0, 1].set(ylabel="J", xlabel="iteration")
panels[1, 0].set(ylabel="cart [m]", xlabel="time [s]")
panels[1, 1].set(ylabel="angle [rad]", xlabel="time [s]")
_ = panels[0, 0].legend(frameon=False)

# %%
scene = CartPole(knots, found["by bumper"][0])
hs.animate(scene, motions["by bumper"], frames_per_second=12, size=(4, 3.2))

# %% [markdown]
# ## The answer
#
# Let the bumper turn the cart: the motor has only to make good what the impact costs. The gradient sees the impact's
# part in the motion, so that the force before it and after it fit together. What it cannot see is an impact that is
# not there: each descent stays with the sequence of impacts that its guess brought. So try guesses with and without,
# and compare.
