"""The entry point: a scene and measurements in, parameters with their uncertainty out."""

import inspect
from collections.abc import Callable, Mapping, Sequence
from contextlib import ExitStack
from pathlib import Path
from typing import Any, Unpack

from ..mechanics.scene import AbstractScene
from ..settings import Settings, chosen_settings
from ..system import AbstractHybridSystem
from ..validation.arguments import as_real, shown, whole_number
from ..validation.asked import kind_of
from ..waiting import waiting
from . import prepare
from .assemble import build_result
from .data import Measurements, measurements
from .descend import Callbacks, Iteration, Limits
from .descents import Way, even_if_interrupted, from_many_starts
from .growing import Growing
from .horizon import GrowingHorizon
from .iterate import BatchSize
from .optimizers import chosen_method
from .parameters import Bounds
from .result import FitResult
from .sizes import with_sizes
from .starts import RandomStarts
from .store import Store, study_digest
from .tables import read_measurements


def fit(
    scene: AbstractScene | AbstractHybridSystem,
    data: Any,
    *,
    parameters: str | Sequence[str] | None = None,
    observe: Callable[..., Any] | None = None,
    state: Any = None,
    mode: Any = None,
    bounds: Bounds | None = None,
    priors: Mapping[str, tuple[float, float]] | None = None,
    robust: float | None = None,
    t0: float = 0.0,
    t1: float | None = None,
    optimizer: Any = "levenberg-marquardt",
    strategy: GrowingHorizon | None = None,
    starts: int | RandomStarts = 1,
    max_iterations: int = 100,
    patience: int = 20,
    progress: bool | Callable[[Iteration], Any] | None = None,
    store: str | Path | None = None,
    **settings: Unpack[Settings],
) -> FitResult:
    """Parameters of a scene or a hybrid system from measurements of its motion, by least squares on exact derivatives.

        minimise  loss = 1/2 (sum ((observe - measured) / sigma)^2 + sum ((event time - measured) / sigma)^2
                              + sum ((parameter - mean) / sigma)^2 of priors)

    This half of a sum of squares is `result.loss`, and what the progress shows; sigmas that are not given count as 1.
    The loss is smooth as long as the events keep their sequence; where a step changes it, the history says so. A trial
    point whose motion fails, or whose residuals or derivatives are not finite, is never taken.

    Intervals need noise that is known or seen. If no sigmas are given and the residuals are zero to rounding, they are
    nan; a parameter on which nothing measured depends has an infinite one. `print(result)` says both.

    Arguments:

    - `scene`: the model; its present parameters are the guess.
    - `data`: a CSV file, a pandas or xarray table, a mapping, (times, values), or `Measurements`; see
      `read_measurements`.
    - `parameters`: names of what is fitted (["stiffness", "arm.length", "masses[0]"]), or one name; default all.
    - `observe`: `observe(scene, t, q, v)` or `observe(system, t, x)` -> (observation,), or a list of scalars, or a
      mapping of column names to scalars; default: the scene's method `observe(t, q, v)`, a system's `observe(t, x)`;
      without one, columns are named after the state, q0, v0, ..., as the scene's `coordinates` and their rates, or
      after the leaves of x. A unit may follow, "q0 [m]".
    - `state`: initial state, or a function of the scene that returns it; default `scene.initial_state()`.
    - `mode`: initial mode of a hybrid system or of a scene with switches, or a function of it; default its
      `initial_mode()`, or None. Measured event times are those of a system's events, or of a scene's impacts, and
      `event_contacts` says which of them.
    - `bounds`: name -> "positive" or (lo, hi), None for an open end; kept by a transformation of the parameter.
    - `priors`: name -> (mean, sigma). The values must have sigmas too, by which priors are weighed against them.
    - `robust`: for data with outliers and with sigmas: residuals r [sigmas] count as 2 c^2 (sqrt(1 + (r/c)^2) - 1) in
      place of r^2, with this c, linearly far beyond it (pseudo-Huber); None: all count squared.
    - `t0`, `t1`: horizon [s]; t1 is by default the last measured time, or 10 % beyond the last event if that is later,
      so that an event which comes later is compared with it. One that a motion does not have counts as if at t1.
    - `optimizer`: "levenberg-marquardt", "gauss-newton" (forward sensitivities), "lbfgs", "adam" (the adjoint), an
      Optimistix Gauss-Newton solver, or any Optax optimizer.
    - `strategy`: `GrowingHorizon()` for long or chaotic motions.
    - `starts`: descend from so many points around the guess, and go on from the best: a number, or
      `RandomStarts(count, spread, seed)`. After Ctrl-C the best of those that have finished is returned.
    - `max_iterations`: the most iterations; `patience`: how many may pass without improvement.
    - `progress`: True prints a line for every iteration; a function is called with every `Iteration`, and stops the
      fit by returning True. None, the default, shows on a terminal or in a notebook what is computed; False nothing.
      Ctrl-C ends a fit too. The best point so far is returned, if there is one; `fit(result.scene, ...)` goes on.
    - `store`: a JSON file that holds the best values at any time. If it is there already, the fit goes on from them
      instead of the scene's, and from many `starts` around them if there were fewer before. That of other
      measurements, another model, other numbers in it that are not fitted, or another beginning is refused.
    - `settings`: see `Settings`; rtol = atol = 1e-8, 256 events and 4096 steps by default.

    Raises: ValueError for measurements, names, bounds or priors that do not fit; for priors or event times beside
    values without sigmas; for the `store` of another study; for a guess whose motion fails.
    """
    if not isinstance(scene, AbstractScene | AbstractHybridSystem):
        raise TypeError(f"`scene` must be a scene or a system, and come before the data, but is {kind_of(scene)}.")
    _must_not_be_of_data(settings)
    measured = read_measurements(data)
    check_limits(max_iterations, patience)
    check_robust(robust, measured)
    check_strategy(strategy)
    starts = chosen_starts(starts)
    own = [name for name in inspect.signature(fit).parameters if name != "settings"]
    chosen = chosen_settings("fit", settings, prepare.SETTINGS, arguments=own)
    experiment = prepare.Experiment(state, mode, observe, t0, t1, chosen)
    unknowns = prepare.Unknowns(parameters, bounds, priors)
    problem = prepare.build_problem(scene, measured, unknowns, experiment, robust)
    keeper = None if store is None else Store(Path(store), problem.selection, study_digest(problem, measured))
    kept = None if keeper is None else keeper.read()
    starts_before = 1 if kept is None else kept.starts
    plain = chosen_method(optimizer)
    method = Growing(plain, strategy) if strategy is not None else plain
    with ExitStack() as until_first_line:
        what = "compiling" if progress else "compiling and fitting"
        until_first_line.enter_context(waiting(what, progress is not False))
        listener = _listener(progress, until_first_line.close)
        problem = with_sizes(method, problem, measured)
        keeper = keeper and keeper._replace(selection=problem.selection, starts=starts_before)
        callbacks = Callbacks(listener, keeper, BatchSize() if listener is None else BatchSize(1))
        guess = problem.selection.from_values(problem.selection.values(problem.scene))
        way = Way(method, problem, Limits(max_iterations, patience), callbacks)
        z = guess if kept is None else problem.selection.from_values(kept.values)
        if starts.count > starts_before:
            tell = _start_teller(progress, starts.count, until_first_line.close)
            (descents, several), method = from_many_starts(way, z, starts, tell), plain
        else:
            descents, several = way.to_the_end(z, kept is not None), None
    with waiting("compiling intervals", progress is not False):
        return even_if_interrupted(lambda: build_result(method, problem, measured, guess, descents, several))


def _must_not_be_of_data(settings: Mapping[str, Any]) -> None:
    """Raise TypeError for what belongs to the measurements."""
    of_data = [name for name in inspect.signature(measurements).parameters if name in settings]
    if of_data:
        raise TypeError(
            f"`fit` must be given {', '.join(of_data)} with the data, where these are made: for a table "
            f"fit(scene, read_measurements(table, {of_data[0]}=...)), for arrays measurements(times, values, "
            f"{of_data[0]}=...)."
        )


def _listener(
    progress: bool | Callable[[Iteration], Any] | None, compiled: Callable[[], None]
) -> Callable[[Iteration], Any] | None:
    """What is called after every iteration; the first one shows that the program has been compiled."""
    if not progress:
        return None
    told = _print_line if progress is True else progress

    def hear(line: Iteration) -> Any:
        compiled()
        return told(line)

    return hear


def _start_teller(progress: bool | Callable[[Iteration], Any] | None, count: int, compiled: Callable[[], None]):
    """What is called after every start; a function of the user is called after iterations alone."""

    def hear(number: int, loss: float) -> None:
        compiled()
        if progress is True:
            print(f"start {number} of {count:<4}  loss {loss:<12.6g}", flush=True)

    return hear


def _print_line(line: Iteration) -> None:
    note = line.failure or ("sequence changed" if line.sequence_changed else "" if line.accepted else "rejected")
    print(f"{line.stage:>14} {line.number:>4}  loss {line.loss:<12.6g} |grad| {line.gradient_norm:<10.3g} "
          f"events {line.events:<4} {note}", flush=True)  # fmt: skip


def check_limits(max_iterations: Any, patience: Any) -> None:
    """Raises: ValueError for limits that are no counts."""
    whole_number("`max_iterations`", max_iterations)
    whole_number("`patience`", patience)


def check_robust(robust: Any, measured: Measurements) -> None:
    """Raises: ValueError for a limit that is no positive number, or for data without sigmas to count it in."""
    if robust is not None and not as_real(robust) > 0:
        raise ValueError(f"`robust` must be a positive number or None, but is {robust!r}.")
    if robust is not None and not measured.sigmas_known:
        raise ValueError(
            "`robust` counts in sigmas, so the measurements must have them (columns sigma_<name>, or `sigma`), but "
            "have none."
        )


def check_strategy(strategy: Any) -> None:
    """Raises: TypeError for anything but a `GrowingHorizon`."""
    if strategy is not None and not isinstance(strategy, GrowingHorizon):
        raise TypeError(f"`strategy` must be a GrowingHorizon() or None, but is {shown(strategy)}.")


def chosen_starts(starts: Any) -> RandomStarts:
    """Starts from their number. Raises: ValueError for what is neither a number of starts nor `RandomStarts`."""
    if isinstance(starts, RandomStarts):
        return starts
    return RandomStarts(whole_number("`starts`, if it is not RandomStarts(count, ...),", starts))
