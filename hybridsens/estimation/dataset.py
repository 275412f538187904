"""A fit as an xarray Dataset: parameters with their errors, data with residuals, the history."""

from typing import Any

import numpy as np

from ..export.datasets import optional


def fit_dataset(result: Any):
    """Parameters over `parameter`, measurements and predictions over (`time`, `observation`), iterations over
    `iteration`. Raises: ImportError without xarray."""
    xarray = optional("xarray", "to_xarray()", "fit")
    data, pair = result.data, ("time", "observation")
    coords = {
        "parameter": list(result.labels),
        "other": list(result.labels),
        "time": ("time", np.asarray(data.times), {"units": "s"}),
        "observation": list(data.names),
    }
    variables: dict[str, Any] = {
        **_parameters(result),
        "measured": (pair, data.values),
        "predicted": (pair, result.predictions),
        "residual": (pair, result.residuals, {"long_name": "predicted less measured"}),
        "event_time": ("event", data.event_times, {"units": "s", "long_name": "measured time of an impact"}),
        "event_residual": ("event", result.event_residuals, {"units": "s"}),
        "loss": ("iteration", np.array([line.loss for line in result.history])),
        "gradient_norm": ("iteration", np.array([line.gradient_norm for line in result.history])),
    }
    attributes = {"hybridsens": "fit", "stopped": result.stopped, "final_loss": result.loss, "report": str(result)}
    arrays = {name: (dims, np.asarray(values), *more) for name, (dims, values, *more) in variables.items()}
    return xarray.Dataset(arrays, coords, attributes)


def _parameters(result: Any) -> dict[str, tuple]:
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
