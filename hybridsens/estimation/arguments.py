"""What `fit` is told beside a scene and data: each argument is looked at before anything is compiled."""

from typing import Any

from ..validation.arguments import whole_number
from .data import Measurements
from .given import as_real, shown
from .horizon import GrowingHorizon
from .starts import RandomStarts


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
