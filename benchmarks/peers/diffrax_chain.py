"""Diffrax alone, at its best: a chain of `diffeqsolve`s that end at events, differentiated by autodiff.

The problems are in `diffrax_problems`. A segment ends where its real-valued guard falls
through zero (root finder and direction given, without which the gradient is silently wrong); the resets are
plain `jnp`; the segments are chained by a `lax.scan` as long as the largest number of events allowed.
The running cost is one more component of the state.
"""

import importlib.util
import time

from tests.problems import references

from . import reference
from .diffrax_problems import PROBLEMS

if importlib.util.find_spec("diffrax") is not None:
    import diffrax
    import jax
    import jax.numpy as jnp
    import optimistix as optx


def available() -> str | None:
    """Why this peer cannot run here, or `None` if it can."""
    return None if importlib.util.find_spec("diffrax") else "diffrax is not installed (pip install diffrax)"


def cost(problem: str, parameters, tolerance: float, *, functional=None, max_events=None, horizon=None, adjoint=None):
    """Value of one functional; give it to `jax.grad`, `jax.jit` and `jax.vmap` as it is.

    `max_events` defaults to the number at the nominal parameters; a motion with more gives NaN.
    `adjoint` defaults to `RecursiveCheckpointAdjoint`; `diffrax.ForwardMode()` is for `jax.jacfwd`.
    """
    reference.require(available())
    scene = PROBLEMS[problem]()
    horizon = scene.horizon if horizon is None else horizon
    max_events = references.load(problem).event_count if max_events is None else max_events
    controller = diffrax.PIDController(rtol=tolerance, atol=tolerance)
    adjoint = diffrax.RecursiveCheckpointAdjoint() if adjoint is None else adjoint

    def solve(field, guard, t, state):
        event = diffrax.Event(lambda t, y, args, **_: guard(t, y, args), optx.Newton(1e-10, 1e-10), direction=False)
        solution = diffrax.diffeqsolve(
            diffrax.ODETerm(field), diffrax.Tsit5(), t, horizon, None, state, parameters,
            stepsize_controller=controller, adjoint=adjoint, event=event,
        )  # fmt: skip
        return solution.ts[-1], solution.ys[-1]

    def segment(carry, _):
        t, state = solve(scene.field, scene.guard, *carry)
        return (t, jnp.where(t < horizon, scene.reset(state, parameters), state)), None

    t, state = scene.start(parameters, solve)
    (t, state), _ = jax.lax.scan(
        segment, (jnp.asarray(t, state.dtype), state), length=max_events - scene.events_in_start + 1
    )
    index = references.DEFAULT_FUNCTIONAL[problem] if functional is None else functional
    return jnp.where(t >= horizon, scene.functionals[index](state), jnp.nan)


def main(tolerance: float = 1e-8) -> None:
    """Print errors and times of reverse and forward mode on every problem."""
    reference.require(available())
    jax.config.update("jax_enable_x64", True)

    def seconds(function, parameters):
        return reference.seconds_per_call(lambda: function(parameters).block_until_ready())

    reference.print_header()
    for problem in PROBLEMS:
        parameters = jnp.asarray(references.load(problem).parameters)
        for mode, differentiate, adjoint in (
            ("reverse", jax.grad, diffrax.RecursiveCheckpointAdjoint()),
            ("forward", jax.jacfwd, diffrax.ForwardMode()),
        ):

            def value(p, problem=problem, adjoint=adjoint):
                return cost(problem, p, tolerance, adjoint=adjoint)

            forward = jax.jit(value)
            start = time.perf_counter()
            gradient = jax.jit(differentiate(value)).lower(parameters).compile()
            compile_seconds = time.perf_counter() - start
            found = reference.errors(problem, forward(parameters), gradient(parameters))
            forward_seconds = seconds(forward, parameters)
            gradient_seconds = seconds(gradient, parameters)
            name = f"{problem} Diffrax chain, {mode}"
            reference.print_row(name, found, forward_seconds, gradient_seconds, compile_seconds)


if __name__ == "__main__":
    main()
