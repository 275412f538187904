# %% [markdown]
# # Which tolerance, which solver?
#
# `rtol` and `atol` bound the error of each step, and a solver says how a step is made. **How accurate must they be for
# a gradient that is right to six digits, and what does it cost?**

# %%
import os

import diffrax
import jax
import matplotlib.pyplot as plt
import numpy as np

import hybridsens as hs

hs.configure()

SMALL = bool(os.environ.get("HYBRIDSENS_NOTEBOOKS_SMALL"))  # fewer tolerances, for a quick check that all runs
TOLERANCES = (1e-5, 1e-9) if SMALL else (1e-4, 1e-5, 1e-6, 1e-7, 1e-8, 1e-9, 1e-10, 1e-11, 1e-12)
SOLVERS = (diffrax.Tsit5(),) if SMALL else (diffrax.Bosh3(), diffrax.Tsit5(), diffrax.Dopri8())

# %% [markdown]
# ## By hand
#
# A pendulum strikes a wall. Where it is after 3 s, and its derivative by the restitution, at looser and tighter
# tolerances, against the tightest.

# %%
scene = hs.scenes.PendulumWall()


@jax.jit
def outcome(scene, tolerance):
    def angle(scene):
        motion = hs.simulate(scene, scene.initial_state(), t1=3.0, rtol=tolerance, atol=tolerance)
        return motion.final.q[0], motion.steps.accepted

    (value, steps), slopes = jax.value_and_grad(angle, has_aux=True)(scene)
    return value, slopes.restitution_coefficient, steps


best = outcome(scene, 1e-13)
errors = np.array([[abs(outcome(scene, tol)[k] - best[k]) for k in (0, 1)] for tol in TOLERANCES])
print(" tolerance  steps   error of the angle   of its derivative")
for tol, (value, slope) in zip(TOLERANCES, errors, strict=True):
    print(f"{tol:>10.0e} {outcome(scene, tol)[2]:>6} {value:>20.1e} {slope:>19.1e}")
assert errors[-1].max() < 1e-2 * errors[0].max()

# %%
figure, axes = plt.subplots(figsize=(6, 4), layout="constrained")
axes.loglog(TOLERANCES, errors[:, 0], "o-", color="black", label="angle")
axes.loglog(TOLERANCES, errors[:, 1], "s--", color="#c8553d", label="its derivative by the restitution")
axes.set(xlabel="rtol = atol", ylabel="error")
_ = axes.legend(frameon=False)

# %% [markdown]
# Both fall together, and the tolerance can be read as the digits that one gets, within a factor of some ten or
# hundred: impacts hand errors on.
#
# ## The package's own study
#
# `work_precision` measures errors and times for all combinations, against a tight reference, and recommends.

# %%
study = hs.work_precision(
    scene, solvers=SOLVERS, tolerances=TOLERANCES, methods=[hs.Replay()], progress=False
)  # fmt: skip
study

# %%
hs.plot_work_precision(study)

# %%
chosen = study.recommend(1e-6)
print(f"for six digits of the gradient: {chosen.label}")
assert SMALL or chosen.gradient_error <= 1e-6

# %% [markdown]
# ## The answer
#
# Down to some 1e-6 the choice hardly matters; for more digits a solver of higher order (Dopri8) takes fewer steps. The
# default, Tsit5 at 1e-8, is on the safe side for an optimiser. `hybridsens work-precision pendulum-wall` is this study
# from a terminal.
