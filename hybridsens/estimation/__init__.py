"""Fit: from measured data to parameters, with their uncertainty."""

from .data import Measurements as Measurements
from .data import measurements as measurements
from .fit import fit as fit
from .horizon import GrowingHorizon as GrowingHorizon
from .result import FitResult as FitResult
from .starts import RandomStarts as RandomStarts
from .tables import read_measurements as read_measurements
