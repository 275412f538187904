"""Fit: from measured data to parameters, with their uncertainty."""

from .data import Measurements as Measurements
from .data import measurements as measurements
from .fit import fit as fit
from .horizon import GrowingHorizon as GrowingHorizon
from .parameters import parameter_names as parameter_names
from .result import FitResult as FitResult
from .shooting import MultipleShooting as MultipleShooting
from .tables import read_measurements as read_measurements
