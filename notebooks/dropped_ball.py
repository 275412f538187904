# %% [markdown]
# # A real ball: fall, bounce, fall
#
# Motion-capture cameras saw a juggling ball fall from two metres on a floor, bounce, and land again (see
# `data/SOURCES.md`). How elastic was the bounce? And what do the residuals say about the model?

# %%
from pathlib import Path

import hybridsens as hs

hs.configure()

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from hybridsens.estimation import fit, read_measurements

here = Path(__file__).parent if "__file__" in globals() else Path.cwd()
record = read_measurements(here / "data" / "dropped_ball.csv", columns=["z"])
print(f"{record.times.size} heights from {record.times[0]:.2f} to {record.times[-1]:.2f} s")

# %% [markdown]
# The model: gravity, drag that grows with the square of the speed, and one contact. The floor is where the marker was
# when the bounce happened. Only its vertical motion takes part; friction, which would change the rest, is not modelled.


# %%
class DroppedBall(hs.AbstractScene):
    """q'' = -g - drag q' |q'|, q >= floor."""

    height: Float[Array, ""]
    velocity: Float[Array, ""]
    drag: Float[Array, ""]
    """Per mass [1/m]."""
    floor: Float[Array, ""]
    restitution_coefficient: Float[Array, ""]

    def initial_state(self):
        return hs.State(self.height[None], self.velocity[None])

    def mass_matrix(self, q):
        return jnp.eye(1)

    def force(self, t, q, v):
        return -9.81 - self.drag * v * jnp.abs(v)

    def gap(self, t, q):
        return q - self.floor

    def restitution(self):
        return self.restitution_coefficient[None]


# %% [markdown]
# The fit ends just before the second impact, which stays as a test of the prediction.

# %%
guess = DroppedBall(
    height=jnp.array(2.0), velocity=jnp.array(0.0), drag=jnp.array(0.01), floor=jnp.array(0.04),
    restitution_coefficient=jnp.array(0.6),
)  # fmt: skip
result = fit(
    guess, record.between(0.0, 1.14), observe=lambda scene, t, q, v: {"z": q[0]},
    bounds={"restitution_coefficient": (0, 1)},
)  # fmt: skip
print(result)

# %% [markdown]
# The last line of the report is the honest part. Residuals of three millimetres are no noise, neighbours are alike: the
# ball spins after the bounce and its marker's centre wobbles, and a bounce that takes some milliseconds is an instant
# in the model, which is also why the fitted floor lies below the height at rest. The intervals are too narrow by the
# factor named.

# %% [markdown]
# The second impact was not fitted. All 300 frames per second have the ball lowest at 0.627 and at 1.150 s: the model is
# 2 and 5 ms late, for the same reason.

# %%
motion = hs.simulate(result.scene, result.scene.initial_state(), t1=1.2)
bounce, landing = np.asarray(motion.events.time)[:2]
print(f"first impact at {bounce:.4f} s, second at {landing:.4f} s")

# %%
result.plot()
