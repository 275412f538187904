"""An oscillator that strikes an elastic wall once a period, in closed form over any number of periods.

q'' = -q, gap 1/2 - q, from rest at -a: q = -a cos t up to the wall and the same way back, with period
2 arccos(-1 / (2 a)).
"""

import jax.numpy as jnp
import numpy as np

import hybridsens as hs
from tests.problems import one_contact as one

WALL = 0.5
BEYOND = 0.2
"""Where in its period the motion ends."""
STEPS = 40
"""Steps that a period has room for."""


def end_of(periods: int) -> float:
    """The end of the horizon."""
    return (periods + BEYOND) * float(period(1.0))


def period(a):
    """Time from one turning point to the next."""
    return 2 * jnp.arccos(-WALL / a)


def exact(a, periods: int, t1):
    """(q, v) at t1, after so many periods and before the wall is met again."""
    s = t1 - periods * period(a)
    return jnp.stack([-a * jnp.cos(s), a * jnp.sin(s)])


def final_of(periods: int, solver, tolerance: float, adjoint):
    """The final (q, v) and the motion as a function of a, t0 and t1."""

    def final(a, t0, t1):
        scene = one.make(stiffness=1.0, side=-1.0, offset=WALL, e=1.0)
        motion = hs.simulate(
            scene, hs.State(-a[None], jnp.zeros(1)), t0=t0, t1=t1, solver=solver, rtol=tolerance, atol=tolerance,
            max_events=periods + 2, max_steps=STEPS * (periods + 2), adjoint=adjoint, throw=False,
        )  # fmt: skip
        return jnp.concatenate([motion.final.q, motion.final.v]), motion

    return final


def errors(end, events, periods: int) -> dict[str, float]:
    """Impacts missed, relative drift of the energy, and how much of a period the phase is off."""
    q, v = np.asarray(end)
    phase = np.arctan2(v, -q) - (end_of(periods) - periods * float(period(1.0)))
    return {
        "impacts missed or made up": abs(int(events) - periods),
        "energy drift, relative": abs(q**2 + v**2 - 1),
        "phase, of a period": abs(np.angle(np.exp(1j * phase))) / float(period(1.0)),
    }
