"""What a fit returns: also as an xarray Dataset of parameters with their errors, data with residuals, the history."""

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import equinox as eqx
import numpy as np
from jax.typing import ArrayLike

from ..export.datasets import optional, write_netcdf
from ..export.text import preformatted
from ..mechanics.trajectory import Trajectory
from ..numerics.sample_times import at_times
from ..parameters import replace
from ..solution import Solution
from ..system import AbstractHybridSystem
from .data import Measurements
from .descend import INTERRUPTED, EventSequence, Iteration
from .plot import plot_fit
from .report import remarks, report
from .starts import Starts
from .uncertainty import Band, Uncertainty, band, half_width, neighbour_correlation, weak_directions


class FitResult(eqx.Module):
    """A fitted scene, how it was found, and how well it is known. `print` shows it."""

    scene: Any
    """The scene with the fitted parameters."""
    labels: tuple[str, ...]
    """Names of the fitted numbers."""
    values: np.ndarray
    """(parameter,) fitted values, in the order of the labels."""
    guess: np.ndarray
    """(parameter,) where the fit started."""
    on_bound: tuple[str, ...]
    """Parameters on a bound, beyond which the loss goes on falling. Their errors are nan; other parameters' errors hold
    them there."""
    loss: float
    """sum r^2 / 2 at the end, half the sum of squares: of residuals in sigmas, in the data's unit where no sigmas were
    given; priors and robust weighting included."""
    residuals: np.ndarray
    """(sample, observation) model - measurement; NaN where nothing was measured."""
    event_residuals: np.ndarray
    """(event,) time of the motion's impact - time measured [s]."""
    events_missing: np.ndarray
    """Numbers of the measured events that the fitted motion does not have. Each counts as if it were at the end of the
    horizon, where no parameter moves it."""
    jacobian: np.ndarray
    """(residual, parameter) derivative of (residual / sigma) by the parameters, observations first, then event
    times."""
    uncertainty: Uncertainty
    """How well the parameters are determined."""
    history: list[Iteration]
    """Every iteration: its loss, where it stood, and why it failed if it did."""
    stopped: str
    """Why the fit ended; "converged" is what one wants, also on a bound."""
    sequence_start: EventSequence
    """Kinds and contacts of the events at the guess."""
    sequence_end: EventSequence
    """The same at the end."""
    data: Measurements
    """What was measured."""
    trajectory: Trajectory | Solution
    """The fitted motion, at the times measured."""
    predictions: np.ndarray
    """(sample, observation) what the fitted motion shows there, also where nothing was measured."""
    horizon: tuple[float, float]
    """Where the fitted motion begins and ends."""
    starts: Starts | None
    """What became of many starts, if there were any."""
    again: Callable[..., np.ndarray] = eqx.field(repr=False)
    """The same motion for other times; `predict` asks it."""

    def predict(self, times: ArrayLike | Sequence) -> np.ndarray:
        """(*times, observation) what the fitted motion shows at other times of its horizon, a number or an array in any
        order. The first call compiles; the number of times is rounded up inside, so that few of them compile anew.

        Raises: ValueError for times outside of the horizon, which ends with the data unless `t1` was given."""
        return at_times(times, float, self.horizon, self.again)

    @property
    def covariance(self) -> np.ndarray:
        """(parameter, parameter)"""
        return self.uncertainty.covariance

    @property
    def standard_errors(self) -> dict[str, float]:
        """Label -> standard error; inf and nan as in `intervals`."""
        return dict(zip(self.labels, self.uncertainty.standard_errors.tolist(), strict=True))

    @property
    def correlation(self) -> np.ndarray:
        """(parameter, parameter)"""
        return self.uncertainty.correlation

    @property
    def converged(self) -> bool:
        """Whether the optimizer ended where it should, at a motion that has every event that was measured, and the data
        say something of at least one parameter."""
        ended_well = self.stopped == "converged" and self.events_missing.size == 0
        return ended_well and len(self.uncertainty.unseen) < len(self.labels)

    @property
    def interrupted(self) -> bool:
        """Whether Ctrl-C ended the fit: this is the best point until then. To go on, fit `scene` again."""
        return self.stopped == INTERRUPTED

    @property
    def residual_correlation(self) -> dict[str, float]:
        """Column -> correlation of neighbouring residuals: about 0 for noise; near 1 where the model leaves something
        out, and then the intervals are too narrow. NaN for fewer than three."""
        return {name: neighbour_correlation(r) for name, r in zip(self.data.names, self.residuals.T, strict=True)}

    @property
    def undetermined(self) -> tuple[str, ...]:
        """Parameters of which the data say nothing, each by itself or in a direction of several; their priors may."""
        known = zip(self.labels, self.uncertainty.standard_errors, strict=True)
        return tuple(label for label, error in known if np.isinf(error) or label in self.uncertainty.unseen)

    @property
    def remarks(self) -> list[str]:
        """Sentences of the report: what the data do not determine, and what speaks against the intervals."""
        return remarks(self)

    @property
    def iterations(self) -> int:
        """Trial points tried in all stages of the main run."""
        return sum(line.number > 0 for line in self.history)

    @property
    def failures(self) -> int:
        """Trial points that could not be evaluated, and were rejected."""
        return sum(bool(line.failure) for line in self.history)

    @property
    def sequence_changes(self) -> int:
        """How often an accepted step changed the event sequence."""
        return sum(line.sequence_changed for line in self.history)

    def intervals(self, level: float = 0.95) -> dict[str, tuple[float, float]]:
        """Confidence intervals: label -> (low, high). First-order; not cut at bounds. (-inf, inf) for a parameter of
        which the data say nothing; nan on a bound, and where no sigmas were given and the residuals are zero to
        rounding."""
        half = half_width(self.uncertainty.standard_errors, level, self.uncertainty.quantile_freedom)
        return {label: (float(p - h), float(p + h)) for label, p, h in zip(self.labels, self.values, half, strict=True)}

    def interval_of(self, function: Callable[[Any], Any], level: float = 0.95) -> Band:
        """What `function(scene)` makes of the fitted scene, and between which bounds that lies: (value, low, high), of
        the shape that it returns. So another experiment is predicted, from another state or for longer.

        The bounds are g(p) -+ t (J C J^T)^(1/2), with the derivative J of g by the fitted numbers p, the covariance C
        of these, and Student's t for the `level`: first-order, as `intervals`, and without the noise of a measurement.
        J is found in forward mode: motions take `adjoint=hs.ForwardSensitivities()`. (-inf, inf) where it depends on a
        parameter of which the data say nothing; one on its bound is held there. Raises: TypeError unless an array is
        returned."""
        of_values = lambda p: function(replace(self.scene, dict(zip(self.labels, p, strict=True))))
        return band(of_values, self.values, self.uncertainty, level)

    def weak_directions(self, limit: float = 0.5) -> list[tuple[float, dict[str, float]]]:
        """Directions of relative change known worse than `limit`, beside `uncertainty.null_directions`."""
        return weak_directions(self.labels, self.values, self.covariance, limit)

    _repr_html_ = preformatted  # what a notebook shows

    def to_xarray(self):
        """An xarray Dataset: parameters with their errors over `parameter`, measurements and predictions with residuals
        over (`time`, `observation`), the history over `iteration`. Raises: ImportError without xarray."""
        xarray = optional("xarray", "to_xarray()", "fit")
        data, pair = self.data, ("time", "observation")
        seconds = {} if isinstance(self.scene, AbstractHybridSystem) else {"units": "s"}
        coords = {
            "parameter": list(self.labels),
            "other": list(self.labels),
            "time": ("time", np.asarray(data.times), seconds),
            "observation": list(data.names),
        }
        variables: dict[str, Any] = {
            **_parameters(self),
            "measured": (pair, data.values),
            "predicted": (pair, self.predictions),
            "residual": (pair, self.residuals, {"long_name": "predicted less measured"}),
            "event_time": ("event", data.event_times, seconds | {"long_name": "measured time of an event"}),
            "event_residual": ("event", self.event_residuals, seconds),
            "loss": ("iteration", np.array([line.loss for line in self.history])),
            "gradient_norm": ("iteration", np.array([line.gradient_norm for line in self.history])),
        }
        attributes = {"hybridsens": "fit", "stopped": self.stopped, "final_loss": self.loss, "report": str(self)}
        arrays = {name: (dims, np.asarray(values), *more) for name, (dims, values, *more) in variables.items()}
        return xarray.Dataset(arrays, coords, attributes)

    def to_pandas(self):
        """A pandas DataFrame of the parameters, by label: value, guess, standard error, and the ends of the 95 %
        interval. Raises: ImportError without pandas."""
        pandas = optional("pandas", "to_pandas()")
        columns = {name: values for name, (dims, values, *_) in _parameters(self).items() if dims == "parameter"}
        return pandas.DataFrame(columns, index=pandas.Index(self.labels, name="parameter"))

    def save(self, path: str | Path) -> None:
        """Write the Dataset of `to_xarray()` to a netCDF file (.nc), which `hybridsens.load` or xarray opens. The scene
        is not in it.

        Raises: ImportError without xarray and netCDF4; ValueError for another ending."""
        write_netcdf(self.to_xarray(), path)

    def __str__(self) -> str:
        return report(self)

    def plot(self):
        """A Matplotlib figure of data and fit, residuals, and convergence; see `plot.plot_fit`."""
        return plot_fit(self)


def _parameters(result: FitResult) -> dict[str, tuple]:
    intervals = np.array([*result.intervals().values()]).reshape(-1, 2)
    return {
        "value": ("parameter", result.values),
        "guess": ("parameter", result.guess),
        "standard_error": ("parameter", result.uncertainty.standard_errors),
        "low": ("parameter", intervals[:, 0], {"long_name": "lower end of the 95 % interval"}),
        "high": ("parameter", intervals[:, 1], {"long_name": "upper end of the 95 % interval"}),
        "covariance": (("parameter", "other"), result.covariance),
        "correlation": (("parameter", "other"), result.correlation),
    }
