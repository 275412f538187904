"""Diffrax alone on the ready-made systems: a scan of `diffeqsolve`s that end at an event or at a known time.

What somebody writes who has the system's functions and follows Diffrax's advice: one real-valued guard with a root
finder and a direction, known times as ends of solves, resets in plain JAX, the running cost one more component.
"""

from collections.abc import Callable
from typing import NamedTuple

import diffrax
import jax
import jax.numpy as jnp
import optimistix as optx


class Chain(NamedTuple):
    """What the chain has to know of a system beside its functions."""

    guard: Callable
    """(system, t, x, mode) -> the one guard of the state."""
    fallen: Callable
    """(system, mode) -> which event that is."""
    known: Callable
    """(system, t, mode) -> the next known time, and which event that is."""


def never(system, t, mode):
    """No time is known."""
    return jnp.inf, 0


thermostat = Chain(lambda s, t, x, mode: s.guards(t, x, mode)[0], lambda s, mode: 0, never)


def _next_input(system, t, mode):
    later = jnp.where(system.input_times > t, system.input_times, jnp.inf)
    return jnp.min(later), 1 + jnp.argmin(later)


neuron = Chain(lambda s, t, x, mode: s.threshold - x["v"][0], lambda s, mode: 0, _next_input)

converter = Chain(
    lambda s, t, x, mode: jnp.min(s.guards(t, x, mode)),
    lambda s, mode: mode["carrier"],
    lambda s, t, mode: ((mode["cycle"] + 1) * s.period, 2),
)


def cost(system, chain: Chain, horizon, tolerance: float, max_events: int):
    """J of a system; more events than `max_events` give nan."""

    def field(t, y, mode):
        return system.flow(t, y[0], mode), system.running_cost(t, y[0], mode)

    def segment(carry, _):
        t, y, mode = carry
        known, which = chain.known(system, t, mode)
        stop = jnp.minimum(known, horizon)
        event = diffrax.Event(
            lambda t, y, args, **_: chain.guard(system, t, y[0], args), optx.Newton(1e-10, 1e-10), direction=False
        )
        solved = diffrax.diffeqsolve(
            diffrax.ODETerm(field), diffrax.Tsit5(), t, stop, None, y, mode, event=event, max_steps=256,
            stepsize_controller=diffrax.PIDController(rtol=tolerance, atol=tolerance),
        )  # fmt: skip
        t, (x, z) = solved.ts[-1], jax.tree.map(lambda leaf: leaf[-1], solved.ys)
        happens = solved.event_mask | (stop < horizon)
        fallen = jnp.where(solved.event_mask, chain.fallen(system, mode), which)
        after, next_mode = system.transition(fallen, t, x, mode)
        choose = lambda new, old: jax.tree.map(lambda n, o: jnp.where(happens, n, o), new, old)
        return (t, (choose(after, x), z), choose(next_mode, mode)), None

    start = (jnp.zeros(()), (system.initial_state(), jnp.zeros(())), system.initial_mode())
    (t, (_, z), _), _ = jax.lax.scan(segment, start, length=max_events + 1)
    return jnp.where(t >= horizon, z, jnp.nan)
