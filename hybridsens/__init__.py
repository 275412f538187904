"""Hybrid mechanical motions (impacts, captures, sustained contact, releases) and their exact gradients, in JAX."""

from . import scenes as scenes
from .adjoint.methods import ContinuousCostate as ContinuousCostate
from .adjoint.methods import DiffraxAdjoint as DiffraxAdjoint
from .adjoint.methods import ForwardSensitivities as ForwardSensitivities
from .adjoint.methods import Replay as Replay
from .configure import configure as configure
from .hybrid import AbstractHybridSystem as AbstractHybridSystem
from .hybrid import Decision as Decision
from .mechanics.mode import EventKind as EventKind
from .mechanics.scene import AbstractScene as AbstractScene
from .mechanics.scene import State as State
from .simulate import simulate as simulate
from .status import Status as Status
from .trajectory import Events as Events
from .trajectory import SimulationError as SimulationError
from .trajectory import Trajectory as Trajectory

_STUDIES = {
    "check_gradient": "check_gradient",
    "compare": "compare",
    "plot_comparison": "compare_plot",
    "work_precision": "work_precision",
    "lyapunov": "lyapunov",
    "plot_work_precision": "work_precision_plot",
    "fit": "fit",
    "FitResult": "fit",
    "GrowingHorizon": "fit",
    "MultipleShooting": "fit",
    "measurements": "fit",
    "read_measurements": "fit",
    "sweep": "sweep",
    "grid": "sweep",
    "latin_hypercube": "sweep",
    "sobol": "sweep",
    "plot_sweep": "sweep",
    "plot_bifurcation": "sweep",
}


def __getattr__(name: str):
    """The studies are imported when they are first asked for: they bring libraries that a simulation does not need."""
    if name not in _STUDIES:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    from importlib import import_module

    return getattr(import_module(f".study.{_STUDIES[name]}", __name__), name)
