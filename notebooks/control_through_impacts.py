# %% [markdown]
# # Optimal control through impacts: a cart with a pendulum between two bumpers
#
# A motor pushes a cart that carries a pendulum. The track is short, with a bumper at either end. Within 2 s the cart
# must come to the right end of its track, and the pendulum must hang still there. **Which force does it with the least
# effort, and may the cart use the bumpers?**

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
ITERATIONS = 30 if SMALL else 1500

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
# The cart begins at rest at the left, -0.3 m, must end at 0.3 m, at rest, with the pendulum at rest; effort is the
# mean square of the force. $J$ = 100 (distance from that state)$^2$ + effort / 10.

# %%
T = 2.0
knots = jnp.linspace(0.0, T, 11)
start = hs.State([-0.3, 0.0], [0.0, 0.0])
target = jnp.array([0.3, 0.0])


def cost(values):
    end = hs.simulate(CartPole(knots, values), start, t1=T, max_events=16).final
    miss = jnp.sum((end.q - target) ** 2) + jnp.sum(end.v**2)
    return 100 * miss + 0.1 * jnp.mean(values**2), miss


# %% [markdown]
# ## Descent
#
# Adam, from two guesses. The first pushes gently; the second throws the cart against the right bumper. A gradient
# follows each motion with the impacts that it has.

# %%
rule = optax.adam(optax.cosine_decay_schedule(0.2, ITERATIONS))


@eqx.filter_jit
def step(values, memory):
    (value, miss), gradient = jax.value_and_grad(cost, has_aux=True)(values)
    change, memory = rule.update(gradient, memory)
    return values + change, memory, value, miss


def descend(values):
    memory, history = rule.init(values), []
    for _ in range(ITERATIONS):
        values, memory, value, miss = step(values, memory)
        history.append(float(value))
    return values, history, float(miss)


guesses = {"gentle": jnp.where(knots < T / 2, 1.0, -1.0), "against the bumper": jnp.where(knots < T / 2, 3.0, 0.0)}
found = {name: descend(guess) for name, guess in guesses.items()}
ts = jnp.linspace(0.0, T, 401)
motions = {name: hs.simulate(CartPole(knots, values), start, t1=T, ts=ts) for name, (values, *_) in found.items()}
for name, (_, history, miss) in found.items():
    impacts = int(motions[name].events.count)
    print(f"{name:>18}: J {history[0]:8.3f} -> {history[-1]:.4f}, distance from the target {miss**0.5:.4f}; "
          f"{impacts} impacts on the way")  # fmt: skip

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
scene = CartPole(knots, found["against the bumper"][0])
hs.animate(scene, motions["against the bumper"], frames_per_second=12, size=(4, 3.2))

# %% [markdown]
# ## The answer
#
# Both descents end at the target. The gradient sees the bumper's part in the motion, so that the force after the
# impact is right for the speed that the bumper leaves. What it cannot see is an impact that is not there: each descent
# stays with the sequence of impacts that its guess brought, unless it passes through a kink by chance. So try guesses
# with and without, and compare.
