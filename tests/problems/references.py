"""The known values and gradients of the reference problems."""

import json
from pathlib import Path
from typing import NamedTuple

import numpy as np

RECORDS = json.loads(Path(__file__).with_name("references.json").read_text())
"""The reference problems' digits: 25 to 30 places from closed forms, gradients included."""

# Index of the functional that is compared where a problem has several: P1 'int q^2', P3 'x(T)'.
DEFAULT_FUNCTIONAL = {"P1": 1, "P2": 0, "P2b": 0, "P3": 0, "P4": 0}


class Reference(NamedTuple):
    parameters: np.ndarray  # nominal values, in the order of `names`
    names: tuple[str, ...]
    value: float
    gradient: np.ndarray  # one entry per parameter
    event_count: int


def load(problem: str, functional: int | None = None) -> Reference:
    """The reference of one problem, rounded from 30 digits to float64."""
    record = RECORDS[problem]
    index = DEFAULT_FUNCTIONAL[problem] if functional is None else functional
    gradient = np.array([float(entry) for entry in record["dJ"][index]])
    parameters, value = np.array(record["p"]), float(record["J"][index])
    return Reference(parameters, tuple(record["names"]), value, gradient, record["n_events"])
