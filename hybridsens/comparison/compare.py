"""Gradient methods side by side on one scene: what each gives, and what each costs."""

from collections.abc import Mapping, Sequence
from typing import Any, Unpack

import diffrax
import jax
import jax.numpy as jnp
import numpy as np

from ..adjoint.methods import AbstractGradientMethod, Replay
from ..outcome import SimulationError
from ..parameters import FlatParameters, flatten_parameters
from ..settings import Settings, chosen_settings
from ..system import AbstractHybridSystem
from ..validation.arguments import real_tolerance, whole_number
from ..waiting import counted, waiting
from .compare_table import Comparison as Comparison
from .compare_table import Reference as Reference
from .compare_table import Row as Row
from .differentiate import value_and_gradient
from .functional import (
    CallReport,
    Cost,
    all_reached_end,
    choose_cost,
    functional,
    raise_unless_reached_end,
    told_of_the_cost,
)
from .gradient_methods import (
    DEFAULT_ADJOINTS,
    GradientMethod,
    differences,
    gradient_at_tolerances,
    naive_methods,
    naive_methods_of_systems,
    our_methods,
)
from .measure import first_call, measured, planned_memory, reason, relative_error, seconds_per_call


def compare(
    scene: Any,
    cost: Cost | None = None,
    *,
    tolerance: float = 1e-8,
    steps: int = 10_000,
    adjoints: Sequence[AbstractGradientMethod] = DEFAULT_ADJOINTS,
    methods: Sequence[GradientMethod] | None = None,
    reference: Reference | None = None,
    progress: bool = True,
    **settings: Unpack[Settings],
) -> Comparison:
    """Value and gradient of a cost by this package's methods and by naive ones, with their errors, times and memory.

    Arguments:

    - `scene`: a scene or a hybrid system; the parameters are its floating point leaves. Any PyTree will do if the cost
      can make a scene of it.
    - `cost`: `cost(scene, simulate)`, or `cost(system, solve)`, a scalar. It must move its scene by the function that
      it is given, outside of `jax.jit` and `jax.vmap` and without settings of its own: each method puts its own in
      that place. Default: the running cost of a ready-made scene.
    - `tolerance`: rtol and atol of all methods with error control. `steps`: of those with a fixed step.
    - `adjoints`: which gradient methods of `hybridsens.simulate` to show. A `ContinuousCostate()` is integrated at
      `tolerance` too.
    - `methods`: the whole list of rows instead of `adjoints` and the naive methods.
    - `reference`: value and gradient to compare with; by default `Replay` with Dopri8 at rtol = 1e-13.
    - `progress`: show a bar. Ctrl-C ends the run and keeps the rows that are finished.
    - `settings`: see `Settings`; rtol = atol = `tolerance`, 256 events and 4096 steps by default. The reference has
      four times the steps.

    A method that fails has the reason in its row. Raises: SimulationError if the reference itself fails; ValueError for
    a `tolerance` that is not positive, or less than one step.
    """
    real_tolerance("tolerance", tolerance)
    whole_number("`steps`", steps)
    cost = choose_cost(scene, cost)
    parameters = flatten_parameters(scene)
    own = dict(rtol=tolerance, atol=tolerance, max_events=256, max_steps=4096)
    chosen = chosen_settings("compare", settings, own)
    if reference is None:
        with waiting("compiling the reference", progress):
            reference = tight_reference(parameters, cost, chosen | dict(max_steps=4 * chosen["max_steps"]))
    if methods is None:
        room = (chosen["max_events"] if reference.event_count is None else reference.event_count) + 2
        methods = our_methods(adjoints, chosen)
        general = isinstance(scene, AbstractHybridSystem)
        methods += naive_methods_of_systems(steps) if general else naive_methods(tolerance, steps, room)
        methods += [differences(chosen)]
    rows = []
    interrupted = False
    try:
        for method in counted(methods, lambda method: method.name, progress):
            rows.append(measure_method(method, parameters, cost, reference))
    except KeyboardInterrupt:
        interrupted = True
    return Comparison(parameters.names, reference, tuple(rows), interrupted)


def tight_reference(parameters: FlatParameters, cost: Cost, settings: Mapping[str, Any]) -> Reference:
    """Value and gradient by `Replay` at the tightest tolerance of the floating point type, and by Dopri8 where the
    settings name no solver. A second run, at ten times the tolerance, tells how well they are known: where motions are
    chaotic, or where value and gradient are nothing but rounding, no tolerance makes them known.

    Raises: SimulationError, which says that it is the reference that failed."""
    tolerance = max(1e-13, 32 * float(jnp.finfo(parameters.vector.dtype).eps))
    solver = settings.get("solver") or diffrax.Dopri8()
    run = gradient_at_tolerances(Replay(), parameters, cost, {**settings, "solver": solver})
    with told_of_the_cost():
        value, gradient, reported = run(parameters.vector, tolerance)
    try:
        raise_unless_reached_end(reported)
    except SimulationError as error:
        raise SimulationError(
            f"The reference, by {type(solver).__name__} at a tolerance of {tolerance:.0e}: {error} Or give "
            "your own, `reference=hybridsens.comparison.compare.Reference(value, gradient)`."
        ) from error
    count = max((int(count) for count in reported.count), default=None)
    value, gradient = float(value), np.asarray(gradient, float)
    looser, slopes, looser_reported = run(parameters.vector, 10 * tolerance)
    if not bool(all_reached_end(looser_reported)):
        looser, slopes = np.inf, np.full(gradient.shape, np.inf)
    errors = relative_error(float(looser), value), relative_error(np.asarray(slopes, float), gradient)
    return Reference(value, gradient, count, _doubt(reported, gradient), *errors)


def _doubt(reported: CallReport, gradient: np.ndarray) -> str:
    """Why a gradient of motions that all reached their ends is not to be trusted; empty where it is."""
    names = sorted({status.name for status in reported.status if status.in_doubt})
    why = [f"its motion has status {' and '.join(names)}"] if names else []
    why += [] if np.all(np.isfinite(gradient)) else ["its gradient is not finite"]
    return f"not to be trusted: {' and '.join(why)}, so no error of a gradient is one" if why else ""


def measure_method(method: GradientMethod, parameters: FlatParameters, cost: Cost, reference: Reference) -> Row:
    """One row: run, compare, time. Any failure of the method becomes its row's `failure`."""
    try:
        with told_of_the_cost():
            return _measure(method, parameters, cost, reference)
    except Exception as error:  # a method that fails must not stop the table
        return Row(method.name, failure=reason(error))


def _measure(method: GradientMethod, parameters: FlatParameters, cost: Cost, reference: Reference) -> Row:
    function = functional(parameters, cost, method.simulate)
    forward = jax.jit(lambda vector: function(vector)[0])
    gradient = value_and_gradient(function, method.mode, all_reached_end)
    vector = parameters.vector
    found = measured(lambda: gradient(vector), reference)
    _, compile_forward = first_call(lambda: forward(vector))
    memory = planned_memory(forward if method.mode == "differences" else gradient, vector)
    return Row(
        method.name, found.value, found.gradient, found.value_error, found.gradient_error,
        seconds_per_call(lambda: forward(vector)), found.seconds, found.first_seconds + compile_forward,
        np.nan if memory is None else float(memory),
    )  # fmt: skip
