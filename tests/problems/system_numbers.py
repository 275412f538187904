"""What the tests of the ready-made systems share: their numbers by the package, and those numbers in 30 digits."""

from functools import cache
from types import SimpleNamespace

import jax
import jax.numpy as jnp
import numpy as np
from jax.flatten_util import ravel_pytree
from mpmath import mp

import hybridsens as hs
from hybridsens.systems import SYSTEMS
from tests.closeness import assert_close
from tests.problems import exact_systems

SMALL = mp.mpf(10) ** -13
"""Step of the truth's own differences: with 30 digits that is exact to twelve."""


def numbers(system, tolerance, adjoint, count):
    """Event times, final state and cost of a system's motion in one vector."""
    made = hs.solve(
        system, system.initial_state(), system.initial_mode(), t1=system.t1, rtol=tolerance, atol=tolerance,
        running_cost=type(system).running_cost, adjoint=adjoint, max_events=count + 1, max_steps=2048,
    )  # fmt: skip
    final = jnp.concatenate([jnp.ravel(leaf) for leaf in jax.tree.leaves(made.final)])
    return jnp.concatenate([made.events.time[:count], final, made.cost[None]]), made.events.count


@cache
def truth(name: str):
    """The same and its Jacobian, by differences of the exact motion; and how many events there are."""
    system = SYSTEMS[name]()
    exact = getattr(exact_systems, type(system).__name__)
    p, unravel = ravel_pytree(system)
    places = vars(unravel(jnp.arange(p.size, dtype=p.dtype)))
    t1 = mp.mpf(system.t1)

    def follow(p, guide=None):
        named = SimpleNamespace(**{field: p[np.asarray(place, int)] for field, place in places.items()})
        return exact.follow(named, t1) if hasattr(exact, "follow") else exact_systems.follow(exact, named, t1, guide)

    p = np.array([mp.mpf(float(entry)) for entry in p], dtype=object)
    base = follow(p)
    columns = []
    for k in range(p.size):
        step = np.array([SMALL if j == k else mp.mpf(0) for j in range(p.size)], dtype=object)
        moved = follow(p + step, base).numbers()
        columns.append([float((new - old) / SMALL) for new, old in zip(moved, base.numbers(), strict=True)])
    return np.array([float(n) for n in base.numbers()]), np.array(columns).T, len(base.times)


def assert_rows_close(found, expected):
    """Each row by its own largest entry, or by 1 where that is smaller."""
    size = np.maximum(1.0, np.abs(expected).max(axis=1, keepdims=True))
    assert_close(found / size, expected / size, 1e-7, scale=1.0)


def reverse_mode(name: str):
    """(p, tolerance) -> numbers, their Jacobian by all parameters, and how many events there are; and p."""
    _, _, count = truth(name)
    p, unravel = ravel_pytree(SYSTEMS[name]())

    def reverse(p, tolerance):
        run = lambda p: numbers(unravel(p), tolerance, hs.Replay(), count)
        value, pull, events = jax.vjp(run, p, has_aux=True)
        return value, jax.lax.map(lambda row: pull(row)[0], jnp.eye(value.size)), events

    return jax.jit(reverse), p


def forward_mode(name: str):
    """(p, tolerance) -> the Jacobian in forward mode; and p."""
    _, _, count = truth(name)
    p, unravel = ravel_pytree(SYSTEMS[name]())
    forward = lambda p, tolerance: numbers(unravel(p), tolerance, hs.ForwardSensitivities(), count)[0]
    return jax.jit(jax.jacfwd(forward)), p
