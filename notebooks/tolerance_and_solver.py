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
# ## Errors over the tolerance
#
# A pendulum strikes a wall. Where it is after 3 s, and its derivative by the restitution, at looser and tighter
# tolerances, against the tightest.

# %%
scene = hs.scenes.PendulumWall()


def outcome_of(solver):
    """(scene, tolerance) -> angle, its derivative, steps tried."""

    def angle(scene, tolerance):
        settings = dict(rtol=tolerance, atol=tolerance, solver=solver, max_steps=65536)
        motion = hs.simulate(scene, scene.initial_state(), t1=3.0, **settings)
        return motion.final.q[0], motion.steps.accepted + motion.steps.rejected

    @jax.jit
    def outcome(scene, tolerance):
        (value, steps), slopes = jax.value_and_grad(angle, has_aux=True)(scene, tolerance)
        return value, slopes.restitution_coefficient, steps

    return lambda tolerance: [float(number) for number in outcome(scene, tolerance)]


best = outcome_of(diffrax.Dopri8())(1e-13)
errors = {}
for solver in SOLVERS:
    run = outcome_of(solver)
    made = np.array([run(tolerance) for tolerance in TOLERANCES])
    errors[type(solver).__name__] = np.abs(made - best)[:, :2], made[:, 2]
(of_value, of_slope), steps = errors["Tsit5"][0].T, errors["Tsit5"][1]
print("Tsit5\n tolerance  steps   error of the angle   of its derivative")
for row in zip(TOLERANCES, steps, of_value, of_slope, strict=True):
    print("{:>10.0e} {:>6.0f} {:>20.1e} {:>19.1e}".format(*row))
assert of_slope[-1] < 1e-2 * of_slope[0]

# %%
figure, axes = plt.subplots(figsize=(6, 4), layout="constrained")
axes.loglog(TOLERANCES, of_value, "o-", color="black", label="angle")
axes.loglog(TOLERANCES, of_slope, "s--", color="#c8553d", label="its derivative by the restitution")
axes.set(xlabel="rtol = atol", ylabel="error", title="Tsit5")
_ = axes.legend(frameon=False)

# %% [markdown]
# Both fall together, and the tolerance can be read as the digits that one gets, within a factor of some ten: impacts
# hand errors on.
#
# ## Errors over the work
#
# A step of a solver of higher order costs more evaluations of the force, but there are fewer steps. Work is counted
# here as steps tried times stages, which is the same on every machine.

# %%
figure, axes = plt.subplots(figsize=(6, 4), layout="constrained")
for solver, style in zip(SOLVERS, ("^:", "o-", "D--"), strict=False):
    found, steps = errors[type(solver).__name__]
    work = steps * (solver.tableau.num_stages - 1)  # the last stage is the first of the next step
    axes.loglog(work, found[:, 1], style, color="black", markersize=5, label=type(solver).__name__)
axes.set(xlabel="evaluations of the force", ylabel="error of the derivative")
axes.grid(color="0.9")
_ = axes.legend(frameon=False)

# %% [markdown]
# ## The answer
#
# For a gradient that is right to six digits a tolerance of 1e-7 will do, and the default, Tsit5 at 1e-8, is on the safe
# side. From some five digits on Dopri8 needs less work here, for fewer Tsit5 does; Bosh3 is never ahead.
#
# How that becomes time depends on the scene and on the machine: `hs.work_precision(scene, cost)`, or `hybridsens
# work-precision pendulum-wall` in a terminal, measures both and recommends.
