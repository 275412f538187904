# %% [markdown]
# # From a CSV file to parameters with intervals
#
# A sensor watched an oscillator that strikes a stop. The file has 200 times, some cells are empty, four readings are
# far off. We want stiffness, damping, drive, the distance of the stop and its restitution, and how well we know them.

# %%
from pathlib import Path

import hybridsens as hs

hs.configure()

from hybridsens.estimation import GrowingHorizon, fit, read_measurements
from hybridsens.scenes import ElasticStop

here = Path(__file__).parent if "__file__" in globals() else Path.cwd()
record = read_measurements(here / "data" / "stop_record.csv", missing="skip")
print(f"{record.times.size} rows of {record.names}")

# %% [markdown]
# The scene with our guess. The mass is known from a balance: mass, stiffness, damping and amplitude together could be
# multiplied by any number without changing the motion, and the fit would say so.

# %%
guess = ElasticStop(
    stiffness=1.2, damping=0.07, amplitude=0.8, frequency=1.2, distance=0.7, restitution_coefficient=0.6
)
names = ["stiffness", "damping", "amplitude", "frequency", "distance", "restitution_coefficient"]
bounds = {name: "positive" for name in names} | {"restitution_coefficient": (0, 1)}

# %% [markdown]
# Outliers are told apart by `robust`: residuals beyond two sigmas count linearly. Over twenty seconds the guess loses
# the phase of the drive, so the horizon grows.

# %%
result = fit(guess, record, parameters=names, bounds=bounds, robust=2.0, strategy=GrowingHorizon())
print(result)

# %% [markdown]
# The intervals of 95 % come from the Jacobian at the minimum, which is exact across the impacts.

# %%
for name, (low, high) in result.intervals(0.95).items():
    print(f"{name:>24}: {low:.4f} ... {high:.4f}")

# %%
result.plot()
