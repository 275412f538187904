"""Do naive gradients get right when the step shrinks? Four problems with impacts, by naive methods and by this package.

    python -m benchmarks.naive_table              # P1 to P4; results/naive_table.csv, docs/naive-gradients.png
    python -m benchmarks.naive_table P2

Errors are relative to references of 25 digits (`tests/problems/references.json`). Methods with error control are run at
several tolerances, those with fixed steps at several numbers of steps; springs keep their stiffness while the step
shrinks.
"""

import argparse
import csv
import json
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import NamedTuple

import numpy as np

import hybridsens as hs
from tests.problems import references

from .machine import describe
from .peers import reference

PROBLEMS = {
    "P1": "bouncing ball, 3 impacts, int q^2 dt",
    "P2": "elastic stop, 5 impacts, int q^2 dt",
    "P3": "off a cylinder, 5 impacts, y(T)",
    "P4": "two balls, 4 impacts, q2(T)",
}
COORDINATE = {"P3": 1, "P4": 1}
"""Which coordinate at the end is the functional; int q^2 dt where none is. On P3 only y feels the impacts."""
FUNCTIONAL = {"P3": 1}
"""Which of the reference's functionals that is, where it is not the default."""
TOLERANCES = (1e-4, 1e-6, 1e-8, 1e-10)
STEPS = (1000, 4000, 16_000, 64_000)


class Row(NamedTuple):
    """One method with one setting on one problem."""

    problem: str
    method: str
    tolerance: float | None
    steps: int | None
    """Steps taken; None where the method does not tell."""
    value_error: float
    """|J - J_ref| / |J_ref|."""
    gradient_error: float
    """max_i |g_i - g_ref,i| / max_i |g_ref,i|."""
    seconds: float
    """One value with its gradient."""


def run_cost(problem: str, simulate: Callable, parameters):
    """The functional of a problem, moved by `simulate`, and the motion."""
    from tests.problems.reference_scenes import SCENES, squared

    scene_of, horizon, _ = SCENES[problem]
    scene, coordinate = scene_of(*parameters), COORDINATE.get(problem)
    running_cost = squared if coordinate is None else None
    motion = simulate(scene, scene.initial_state(), t1=horizon, running_cost=running_cost)
    return (motion.cost if coordinate is None else motion.final.q[coordinate]), motion


def ours(problem: str, tolerances) -> list[Row]:
    """This package at several tolerances, by one compiled function."""
    import jax
    import jax.numpy as jnp

    room = dict(max_events=references.load(problem).event_count + 3, max_steps=4096, throw=False)

    def cost(p, tolerance):
        value, motion = run_cost(problem, partial(hs.simulate, rtol=tolerance, atol=tolerance, **room), p)
        return value, motion.steps.accepted

    both = jax.jit(jax.value_and_grad(cost, has_aux=True))
    return [_row(problem, "hybridsens, Replay", t, None, partial(both, tolerance=jnp.asarray(t))) for t in tolerances]


def naive(problem: str, tolerances, steps) -> list[Row]:
    """What one would write without this package."""
    import jax

    from hybridsens.comparison.baselines import constant_event_time, events_at_step_end, penalty_contact, where_reset

    room = references.load(problem).event_count + 3

    def both(simulate):
        return jax.jit(jax.value_and_grad(lambda p: (run_cost(problem, simulate, p)[0], None), has_aux=True))

    rows = []
    for name, method in (("events at step ends", events_at_step_end), ("event times constant", constant_event_time)):
        for t in tolerances[::2]:
            rows.append(_row(problem, name, t, None, both(partial(method, tolerance=t, max_events=room))))
    for name, method in (("`where` reset", where_reset), ("penalty contact", penalty_contact)):
        rows += [_row(problem, name, None, n, both(partial(method, steps=n))) for n in steps]
    return rows


def _row(problem: str, method: str, tolerance, steps, both) -> Row:
    """Measure and print. `both(p)` is ((value, steps taken), gradient)."""
    import jax
    import jax.numpy as jnp

    p = jnp.asarray(references.load(problem).parameters)
    (value, taken), gradient = both(p)
    found = reference.errors(problem, float(value), np.asarray(gradient), FUNCTIONAL.get(problem))
    seconds = reference.seconds_per_call(lambda: jax.block_until_ready(both(p)), repeats=3)
    steps = steps if taken is None else int(taken)
    row = Row(problem, method, tolerance, steps, found.value, found.gradient, seconds)
    setting = (f"tolerance {tolerance:.0e}" if tolerance else "") + (f"{steps:8} steps" if steps else "")
    errors = f"{row.value_error:10.1e}{row.gradient_error:12.1e}"
    print(f"  {method:22}{setting:32}{errors}{1e3 * seconds:12.3f} ms", flush=True)
    return row


def plot(rows: list[Row], path: Path) -> None:
    """Error of the gradient over the number of steps, one panel for each problem."""
    from matplotlib.figure import Figure

    problems = list(dict.fromkeys(row.problem for row in rows))
    figure = Figure(figsize=(3.1 * len(problems), 3.6), layout="constrained")
    styles = {"`where` reset": "s--", "penalty contact": "D:", "hybridsens, Replay": "o-"}
    for axes, problem in zip(np.ravel(figure.subplots(1, len(problems), sharey=True)), problems, strict=True):
        for method, style in styles.items():
            here = [row for row in rows if (row.problem, row.method) == (problem, method)]
            drawn = [(row.steps, max(row.gradient_error, 1e-16)) for row in here]
            face = "black" if style == "o-" else "white"
            axes.loglog(*zip(*drawn, strict=True), style, color="black", mfc=face, label=method, markersize=5, lw=1)
        axes.set_title(PROBLEMS[problem], fontsize="small")
        axes.set_xlabel("steps")
        axes.grid(color="0.9")
    figure.axes[0].set_ylabel("relative error of the gradient")
    figure.legend(*figure.axes[0].get_legend_handles_labels(), loc="outside upper center", ncols=3, frameon=False)
    figure.savefig(path, dpi=120)


def write(rows: list[Row], path: Path) -> None:
    """The rows, with machine and versions above them."""
    path.parent.mkdir(exist_ok=True)
    with path.open("w", newline="") as file:
        file.write(f"# {json.dumps(describe())}\n")
        table = csv.writer(file)
        table.writerow(Row._fields)
        table.writerows(rows)


def main() -> None:
    """Print the tables, write the rows and the picture."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("problems", nargs="*", default=list(PROBLEMS), metavar="PROBLEM", help=", ".join(PROBLEMS))
    parser.add_argument("--output", type=Path, default=Path("docs/naive-gradients.png"))
    parser.add_argument("--csv", type=Path, default=Path("results/naive_table.csv"))
    arguments = parser.parse_args()
    unknown = set(arguments.problems) - set(PROBLEMS)
    if unknown:
        parser.error(f"no such problem: {', '.join(sorted(unknown))}")
    hs.configure()
    print(json.dumps(describe()))
    rows: list[Row] = []
    for problem in arguments.problems:
        print(f"\n{problem}: {PROBLEMS[problem]}\n{'':56}{'J error':>10}{'gradient':>12}{'time':>15}")
        rows += naive(problem, TOLERANCES, STEPS)
        rows += ours(problem, TOLERANCES)
    write(rows, arguments.csv)
    plot(rows, arguments.output)
    print(f"wrote {arguments.csv} and {arguments.output}")


if __name__ == "__main__":
    main()
