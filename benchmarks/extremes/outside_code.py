"""Outside codes on the same scenes: SciPy's event-driven DOP853 chain and CasADi; event times and final states.

python -m benchmarks.extremes.outside_code
"""

import argparse
import importlib.util

import numpy as np
from scipy.integrate import solve_ivp

import hybridsens as hs
from tests.problems import references

from ..peers import casadi_c, reference
from .report import Row, main_of, status_name

HORIZONS = {
    "elastic-stop": 20.0,
    "bouncing-ball": 1.5,
    "stacked-balls": 1.0,
    "pendulum-wall": 6.0,
    "double-pendulum-wall": 3.0,
}
"""Scenes whose impacts do not accumulate within the horizon: each of these codes jumps, none holds a contact."""


def chain(scene, state, t1: float):
    """Event times and final state by `solve_ivp` with events, one restart for each impact.

    Only the scene's own functions are taken over; kinematics, impact law and event search are written again here.
    """
    import jax
    import jax.numpy as jnp

    accelerate = jax.jit(lambda t, q, v: jnp.linalg.solve(scene.mass_matrix(q), scene.force(t, q, v)))
    gap = jax.jit(lambda t, q: scene.gap(t, q))  # a bound method would be hashed with the scene's arrays
    gradient = jax.jit(jax.jacfwd(lambda t, q: scene.gap(t, q), argnums=1))
    dof, e = state.q.shape[0], np.asarray(scene.restitution())
    x, t, times = np.concatenate([state.q, state.v]), 0.0, []

    def rate(t, x):
        return np.concatenate([x[dof:], accelerate(t, x[:dof], x[dof:])])

    def guard(i):
        function = lambda t, x: float(gap(t, x[:dof])[i])
        function.terminal, function.direction = True, -1
        return function

    guards = [guard(i) for i in range(len(e))]
    while True:
        flight = solve_ivp(rate, (t, t1), x, method="DOP853", events=guards, rtol=1e-12, atol=1e-13)
        x, t = flight.y[:, -1], flight.t[-1]
        if flight.status != 1:
            return np.array(times), x
        struck = next(i for i, found in enumerate(flight.t_events) if len(found))
        normal = np.asarray(gradient(t, x[:dof]))[struck]
        mobility = np.linalg.solve(np.asarray(scene.mass_matrix(x[:dof])), normal)
        x[dof:] -= (1 + e[struck]) * (normal @ x[dof:]) / (normal @ mobility) * mobility
        times.append(t)


def against_scipy() -> list[Row]:
    """Largest difference of event times and of final states."""
    from hybridsens.scenes import SCENES

    rows = []
    for name, t1 in HORIZONS.items():
        scene = SCENES[name]()
        state = scene.initial_state()
        motion = hs.simulate(scene, state, t1=t1, rtol=1e-11, atol=1e-11, throw=False)
        times, final = chain(scene, state, t1)
        count = int(motion.events.count)
        assert count == len(times), f"{name}: {count} impacts here, {len(times)} there"
        ours = np.concatenate([motion.final.q, motion.final.v])
        at = f"{count} impacts"
        rows.append(Row("SciPy DOP853", f"{name}: event times", at, np.max(np.abs(motion.events.time[:count] - times))))
        rows.append(Row("SciPy DOP853", f"{name}: final state", at, np.max(np.abs(ours - final)), status_name(motion)))
    return rows


def against_casadi() -> list[Row]:
    """J and its gradient by generated C code, relative to the reference digits that this package is tested with too."""
    if casadi_c.available() is not None:
        return [Row("CasADi", str(casadi_c.available()), "-", None)]
    rows = []
    for problem in ("P1", "P2", "P4"):
        _, gradient = casadi_c.build(problem)
        found = reference.errors(problem, *gradient(references.load(problem).parameters))
        rows.append(Row("CasADi", "J", problem, found.value))
        rows.append(Row("CasADi", "gradient of J", problem, found.gradient))
    return rows


def against_siconos() -> list[Row]:
    """Siconos is built from source or comes with a system's packages; it is not on the Python package index."""
    found = importlib.util.find_spec("siconos") is not None
    return [] if found else [Row("Siconos", "not installed here, not compared", "-", None)]


def study() -> list[Row]:
    """All of them."""
    return against_scipy() + against_casadi() + against_siconos()


if __name__ == "__main__":
    main_of("outside_code", lambda _: study(), argparse.ArgumentParser(description=__doc__))
