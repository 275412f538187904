"""Motions of hybrid systems (impacts, captures, sustained contact, releases, switches) and their exact gradients."""

from importlib import import_module
from importlib.metadata import version
from typing import TYPE_CHECKING

from . import planar, scenes, systems
from .adjoint.methods import (
    AbstractGradientMethod,
    AnyMode,
    ContinuousCostate,
    DiffraxAdjoint,
    ForwardSensitivities,
    Replay,
)
from .adjoint.step import RecordedStep, StepBack
from .configure import configure
from .delays import DelayQueue
from .discontinuities import DiscontinuityWarning
from .mechanics.events import Events
from .mechanics.lagrangian import LagrangianScene
from .mechanics.mode import EventKind
from .mechanics.scene import AbstractScene, State
from .mechanics.switches import AbstractSwitchedScene
from .mechanics.trajectory import Trajectory
from .outcome import SimulationError, Steps
from .saved import load
from .settings import Settings
from .simulate import simulate
from .solution import Solution, SolutionEvents
from .solve import solve
from .system import AbstractHybridSystem

if TYPE_CHECKING:  # all outcomes by name, those of contacts too
    from .mechanics.status import ContactStatus as Status
else:
    from .status import Status

if TYPE_CHECKING:  # what `__getattr__` below imports, for type checkers and editors
    from .comparison.check_gradient import check_gradient
    from .comparison.check_report import GradientCheck
    from .comparison.compare import compare
    from .comparison.compare_table import Comparison, plot_comparison
    from .comparison.lyapunov import lyapunov
    from .comparison.work_precision import WorkPrecision, plot_work_precision, work_precision
    from .estimation import (
        FitResult,
        GrowingHorizon,
        Measurements,
        RandomStarts,
        fit,
        measurements,
        read_measurements,
    )
    from .plot import (
        Animation,
        animate,
        contact_forces,
        costate,
        plot_contacts,
        plot_coordinates,
        plot_costate,
        plot_fan,
        plot_gradients,
        plot_path,
        plot_phase,
        plot_solution,
        plot_trajectory,
    )
    from .sweeps import (
        Design,
        dgsm,
        grid,
        latin_hypercube,
        plot_bifurcation,
        plot_sweep,
        saltelli,
        sobol,
        sobol_indices,
        sweep,
    )

__version__ = version("hybridsens")

_BY_MODULE = {
    "comparison.check_gradient": "check_gradient",
    "comparison.check_report": "GradientCheck",
    "comparison.compare": "compare",
    "comparison.compare_table": "Comparison plot_comparison",
    "comparison.lyapunov": "lyapunov",
    "comparison.work_precision": "WorkPrecision plot_work_precision work_precision",
    "estimation": "FitResult GrowingHorizon Measurements RandomStarts fit measurements read_measurements",
    "plot": "Animation animate contact_forces costate plot_contacts plot_coordinates plot_costate plot_fan "
    "plot_gradients plot_path plot_phase plot_solution plot_trajectory",
    "sweeps": "Design dgsm grid latin_hypercube plot_bifurcation plot_sweep saltelli sobol sobol_indices sweep",
}
_STUDIES = {name: module for module, names in _BY_MODULE.items() for name in names.split()}
"""Public name -> module that is imported when the name is first asked for: it needs libraries that a simulation does
not."""

__all__ = [
    "AbstractGradientMethod", "AbstractHybridSystem", "AbstractScene", "AbstractSwitchedScene", "Animation", "AnyMode",
    "Comparison", "ContinuousCostate", "DelayQueue", "Design", "DiffraxAdjoint", "DiscontinuityWarning", "EventKind",
    "Events", "FitResult", "ForwardSensitivities", "GradientCheck", "GrowingHorizon", "LagrangianScene", "Measurements",
    "RandomStarts", "RecordedStep", "Replay", "Settings", "SimulationError", "Solution", "SolutionEvents", "State",
    "Status", "StepBack", "Steps", "Trajectory", "WorkPrecision", "animate", "check_gradient", "compare", "configure",
    "contact_forces", "costate", "dgsm", "fit", "grid", "latin_hypercube", "load", "lyapunov", "measurements", "planar",
    "plot_bifurcation", "plot_comparison", "plot_contacts", "plot_coordinates", "plot_costate", "plot_fan",
    "plot_gradients", "plot_path", "plot_phase", "plot_solution", "plot_sweep", "plot_trajectory",
    "plot_work_precision", "read_measurements", "saltelli", "scenes", "simulate", "sobol", "sobol_indices", "solve",
    "sweep", "systems", "work_precision",
]  # fmt: skip


def __getattr__(name: str):
    if name not in _STUDIES:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    value = getattr(import_module(f".{_STUDIES[name]}", __name__), name)
    globals()[name] = value  # the next look finds it without coming here
    return value


def __dir__() -> list[str]:
    return [*__all__, "__version__"]
