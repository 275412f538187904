"""Accuracy against time: error of J and of its gradient over solvers, tolerances, precisions and gradient methods."""

import csv
import itertools
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import diffrax
import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from rich.progress import Progress

from ..adjoint.methods import AbstractGradientMethod, Replay
from .compare import Reference, relative_error, tight_reference
from .differentiate import value_and_gradient
from .failure import reason
from .flat_parameters import FlatParameters, flatten_parameters
from .functional import Cost, choose_cost, functional, raise_unless_reached_end
from .gradient_methods import adjoint_name, from_adjoint
from .measure import first_call, seconds_per_call

TOLERANCES = tuple(10.0**-k for k in range(3, 14))
"""1e-3 ... 1e-13."""


class Point(NamedTuple):
    """One setting, what it reached, and what it cost."""

    solver: str
    method: str
    dtype: str
    tolerance: float
    """rtol = atol."""
    value_error: float = np.nan
    """|J - J_ref| / |J_ref|."""
    gradient_error: float = np.nan
    """max_i |g_i - g_ref,i| / max_i |g_ref,i|."""
    seconds: float = np.nan
    """One value with its gradient."""
    first_seconds: float = np.nan
    """The first call: with tracing and compiling at the first tolerance of each solver and method."""
    failure: str = ""

    @property
    def label(self) -> str:
        """The setting in words."""
        single = ", float32" if self.dtype == "float32" else ""
        return f"{self.solver}, rtol {self.tolerance:.0e}, {self.method}{single}"


class WorkPrecision(NamedTuple):
    """Points of a study. Print it, ask it to `recommend`, or draw it (`hybridsens.plot_work_precision`)."""

    points: tuple[Point, ...]
    interrupted: bool = False
    """Whether Ctrl-C ended the run: the points are those that were finished."""

    def pareto(self, error: str = "gradient_error") -> list[Point]:
        """Points that no other point beats in both time and error, the fastest first."""
        front: list[Point] = []
        for point in sorted((p for p in self.points if not p.failure), key=lambda p: (p.seconds, getattr(p, error))):
            if not front or getattr(point, error) < getattr(front[-1], error):
                front.append(point)
        return front

    def recommend(self, gradient_error: float = 1e-6) -> Point | None:
        """The fastest point whose gradient error is at most this; None where no point reaches it."""
        good = [point for point in self.points if not point.failure and point.gradient_error <= gradient_error]
        return min(good, key=lambda point: point.seconds, default=None)

    def __str__(self) -> str:
        front = set(self.pareto())
        lines = [f"{'':2}{'setting':44}{'value err':>11}{'gradient err':>13}{'time':>12}"]
        for point in self.points:
            numbers = f"{point.value_error:>11.1e}{point.gradient_error:>13.1e}{1e3 * point.seconds:>9.3f} ms"
            mark = "* " if point in front else "  "
            lines.append(f"{mark}{point.label:44}" + (f"  failed: {point.failure}" if point.failure else numbers))
        lines += ["  (interrupted: the remaining points were not run)"] if self.interrupted else []
        lines.append("* no other point is both faster and more accurate")
        return "\n".join([*lines, *map(self.advice, (1e-4, 1e-6, 1e-8))])

    def advice(self, gradient_error: float) -> str:
        """The recommendation in a sentence."""
        best = self.recommend(gradient_error)
        if best is None:
            return f"for gradient error {gradient_error:.0e} on this scene: no point reaches it"
        return f"for gradient error {gradient_error:.0e} on this scene: {best.label}: {1e3 * best.seconds:.3g} ms"


def work_precision(
    scene: Any,
    cost: Cost | None = None,
    *,
    solvers: Sequence[diffrax.AbstractSolver] = (diffrax.Bosh3(), diffrax.Tsit5(), diffrax.Dopri8()),
    tolerances: Sequence[float] = TOLERANCES,
    methods: Sequence[AbstractGradientMethod] = (Replay(),),
    dtypes: Sequence[str] = ("float64",),
    reference: Reference | None = None,
    max_events: int = 256,
    max_steps: int = 65536,
    path: str | Path | None = None,
    progress: bool = True,
) -> WorkPrecision:
    """Error of a cost and of its gradient, and time for both, for every combination of settings.

    Arguments:

    - `scene`, `cost`, `reference`: as for `compare`.
    - `solvers`, `tolerances` (rtol = atol), `methods` (as for `adjoint=`), `dtypes` ("float64",
      "float32"): what is combined.
    - `path`: a CSV file to which each point is written as soon as it is finished.
    - `progress`: show a bar. Ctrl-C ends the run and keeps the points that are finished.

    A setting that fails is a point with its reason. float64 needs `hybridsens.configure()` before JAX starts.

    Raises: ValueError for a dtype other than these two; SimulationError if the reference fails.
    """
    unknown = set(dtypes) - {"float64", "float32"}
    if unknown:
        raise ValueError(f'`dtypes` must have entries among "float64" and "float32", but has {sorted(unknown)}.')
    cost = choose_cost(scene, cost)
    reference = reference or tight_reference(flatten_parameters(scene), cost, max_events, max_steps)
    room = dict(max_events=max_events, max_steps=max_steps)
    lines = list(itertools.product(dtypes, solvers, methods))
    points: list[Point] = []
    try:
        with Progress(disable=not progress, transient=True) as bar:
            task = bar.add_task("measuring", total=len(lines) * len(tolerances))
            for dtype, solver, method in lines:
                bar.update(task, description=f"{type(solver).__name__}, {adjoint_name(method)}, {dtype}")
                for point in measure_line(scene, cost, dtype, solver, method, tolerances, reference, room):
                    points.append(point)
                    append_csv(points, path)
                    bar.advance(task)
    except KeyboardInterrupt:
        return WorkPrecision(tuple(points), interrupted=True)
    return WorkPrecision(tuple(points))


def measure_line(
    scene, cost: Cost, dtype: str, solver, method, tolerances, reference: Reference, room
) -> Iterator[Point]:  # fmt: skip
    """Points of one solver, method and dtype: one program for all tolerances. A failure stands in its point."""
    with jax.enable_x64(dtype == "float64"):  # what a scene makes out of nothing must have this type too
        cast = lambda leaf: jnp.asarray(leaf, dtype) if eqx.is_inexact_array(leaf) else leaf
        parameters = flatten_parameters(jax.tree.map(cast, scene))
        gradient = _gradient(parameters, cost, solver, method, room)
        for tolerance in tolerances:
            setting = type(solver).__name__, adjoint_name(method), dtype, tolerance
            try:
                yield Point(*setting, *_measure(lambda t=tolerance: gradient(parameters.vector, t), reference))
            except Exception as error:  # a setting that fails must not stop the study
                yield Point(*setting, failure=reason(error))


def _gradient(parameters: FlatParameters, cost: Cost, solver, method: AbstractGradientMethod, room):
    """(vector, tolerance) -> value, gradient, what the motions report."""

    @jax.jit
    def gradient(vector, tolerance):
        tolerance = jnp.asarray(tolerance, vector.dtype)
        row = from_adjoint(method, solver=solver, rtol=tolerance, atol=tolerance, **room)
        return value_and_gradient(functional(parameters, cost, row.simulate), row.mode)(vector)

    return gradient


def _measure(call, reference: Reference):
    (value, slopes, reported), seconds = first_call(call)
    raise_unless_reached_end(reported)
    value_error = relative_error(float(value), reference.value)
    gradient_error = relative_error(np.asarray(slopes, float), reference.gradient)
    return value_error, gradient_error, seconds_per_call(call), seconds


def append_csv(points: Sequence[Point], path: str | Path | None) -> None:
    """Write the last point to a CSV file; the first one starts the file."""
    if path is None:
        return
    with open(path, "w" if len(points) == 1 else "a", newline="") as file:
        writer = csv.writer(file)
        if len(points) == 1:
            writer.writerow(Point._fields)
        writer.writerow(points[-1])
