"""Value and gradient of the reference problems by this package and by every peer: errors and times in one table.

    python -m benchmarks.peers_table                    # all problems
    python -m benchmarks.peers_table P2 --tolerance 1e-8

Each row has its own errors beside its times. A peer that is not installed, or has no form of a problem, is a row that
says so. Times are medians of calls from Python on one machine; the loop inside C or numba is in the peers' own `main`.
Rows also go to results/peers.csv.
"""

import argparse
import csv
import json
import time
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import NamedTuple

import numpy as np

import hybridsens as hs
from tests.problems import references

from .machine import describe
from .peers import casadi_c, diffrax_chain, mjx_limits, numba_saltation, reference, torchdiffeq_events

PROBLEMS = ("P1", "P2", "P2b", "P3", "P4")


class Contender(NamedTuple):
    """One row of each problem."""

    name: str
    available: Callable[[], str | None]
    problems: tuple[str, ...]
    build: Callable
    """(problem, tolerance) -> value(p), value_and_gradient(p), both waiting for their results."""


COLUMNS = (
    "problem", "who", "value_error", "gradient_error", "worst_entry", "forward_seconds", "gradient_seconds",
    "compile_seconds", "failure",
)  # fmt: skip


def ours(problem: str, tolerance: float, *, adjoint):
    """This package, in the parameters of the reference problem."""
    import jax

    from tests.problems.reference_scenes import cost

    value = lambda p: cost(problem, p, tolerance, adjoint)
    if isinstance(adjoint, hs.ForwardSensitivities):
        gradient = lambda p: (value(p), jax.jacfwd(value)(p))
    else:
        gradient = jax.value_and_grad(value)
    return tuple(_waiting(jax.jit(function)) for function in (value, gradient))


def chain(problem: str, tolerance: float, *, forward: bool):
    """Diffrax alone, in forward or in reverse mode."""
    import diffrax
    import jax

    adjoint = diffrax.ForwardMode() if forward else diffrax.RecursiveCheckpointAdjoint()
    value = lambda p: diffrax_chain.cost(problem, p, tolerance, adjoint=adjoint)
    gradient = (lambda p: (value(p), jax.jacfwd(value)(p))) if forward else jax.value_and_grad(value)
    return tuple(_waiting(jax.jit(function)) for function in (value, gradient))


def _waiting(function):
    import jax

    return lambda p: jax.block_until_ready(function(p))


def casadi(problem: str, tolerance: float):
    """Generated C with fixed steps; its step counts are chosen for a gradient error like that of tolerance 1e-8."""
    del tolerance
    return casadi_c.build(problem)


def numba(problem: str, tolerance: float):
    """Hand-written Dormand-Prince with saltation; its value alone is not offered apart."""
    both = partial(numba_saltation.value_and_gradient, problem, tolerance=tolerance)
    return (lambda p: both(p)[0]), both


def torchdiffeq(problem: str, tolerance: float, *, carried: bool):
    """A Python loop of `odeint_event`; value and gradient together."""
    both = partial(torchdiffeq_events.value_and_gradient, problem, tolerance=tolerance, carried=carried)
    return (lambda p: both(p)[0]), both


def mjx(problem: str, tolerance: float):
    """MuJoCo's soft limits in fixed steps, in forward mode."""
    return tuple(_waiting(function) for function in mjx_limits.build(problem, tolerance))


CONTENDERS = (
    Contender("hybridsens, Replay", lambda: None, PROBLEMS, partial(ours, adjoint=hs.Replay())),
    Contender("hybridsens, ForwardSensitivities", lambda: None, PROBLEMS,
              partial(ours, adjoint=hs.ForwardSensitivities())),
    Contender("numba by hand, saltation", numba_saltation.available, ("P1", "P2", "P2b"), numba),
    Contender("CasADi, generated C, adjoint", casadi_c.available, ("P1", "P2", "P2b", "P4"), casadi),
    Contender("Diffrax chain, reverse", diffrax_chain.available, PROBLEMS, partial(chain, forward=False)),
    Contender("Diffrax chain, forward", diffrax_chain.available, PROBLEMS, partial(chain, forward=True)),
    Contender("torchdiffeq, p in the state", torchdiffeq_events.available, ("P1", "P2", "P2b"),
              partial(torchdiffeq, carried=True)),
    Contender("torchdiffeq, p closed over", torchdiffeq_events.available, ("P1", "P2", "P2b"),
              partial(torchdiffeq, carried=False)),
    Contender("MuJoCo MJX, forward", mjx_limits.available, ("P1", "P2", "P2b"), mjx),
)  # fmt: skip


def run_contender(problem: str, contender: Contender, tolerance: float) -> tuple:
    """Print one row, errors and times or why there are none, and return it (`COLUMNS`)."""
    missing = contender.available()
    if missing is None and problem not in contender.problems:
        missing = f"has no form of {problem} here"
    if missing is None:
        try:
            return _measured(problem, contender, tolerance)
        except Exception as error:  # one peer's failure must not stop the table
            missing = f"failed: {type(error).__name__}: {(str(error).splitlines() or ['no message'])[0]}"
    print(f"{contender.name:34}  {missing}", flush=True)
    return problem, contender.name, *[""] * 6, missing


def _measured(problem: str, contender: Contender, tolerance: float) -> tuple:
    parameters = references.load(problem).parameters
    start = time.perf_counter()
    value, both = contender.build(problem, tolerance)
    cost, gradient = both(parameters)
    found = reference.errors(problem, float(cost), np.asarray(gradient))
    value(parameters)
    compile_seconds = time.perf_counter() - start
    repeats = 3 if compile_seconds > 60 else 9
    forward, gradient = (reference.seconds_per_call(f, parameters, repeats=repeats) for f in (value, both))
    reference.print_row(contender.name, found, forward, gradient, compile_seconds)
    return problem, contender.name, *found, forward, gradient, compile_seconds, ""


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("problems", nargs="*", default=PROBLEMS, metavar="PROBLEM", help="of " + ", ".join(PROBLEMS))
    parser.add_argument("--tolerance", type=float, default=1e-8)
    parser.add_argument("--csv", type=Path, default=Path("results/peers.csv"))
    arguments = parser.parse_args()
    unknown = set(arguments.problems) - set(PROBLEMS)
    if unknown:
        parser.error(f"no such problem: {', '.join(sorted(unknown))}")
    hs.configure()
    machine = json.dumps(describe() | {"tolerance": arguments.tolerance})
    print(machine)
    rows = []
    for problem in arguments.problems:
        print(f"\n{problem}")
        reference.print_header()
        rows += [run_contender(problem, contender, arguments.tolerance) for contender in CONTENDERS]
    arguments.csv.parent.mkdir(exist_ok=True)
    with arguments.csv.open("w", newline="") as file:
        file.write(f"# {machine}\n")
        csv.writer(file).writerows([COLUMNS, *rows])


if __name__ == "__main__":
    main()
