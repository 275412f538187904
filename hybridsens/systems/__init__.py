"""Ready-made hybrid systems that are not mechanical scenes, by name."""

from .buck_converter import BuckConverter as BuckConverter
from .dosing import Dosing as Dosing
from .neurons import Neurons as Neurons
from .rimless_wheel import RimlessWheel as RimlessWheel
from .shipped import ShippedSystem as ShippedSystem
from .stick_slip import StickSlip as StickSlip
from .thermostat import Thermostat as Thermostat
from .two_tanks import TwoTanks as TwoTanks

SYSTEMS: dict[str, type[ShippedSystem]] = {
    "thermostat": Thermostat,
    "neurons": Neurons,
    "buck-converter": BuckConverter,
    "dosing": Dosing,
    "rimless-wheel": RimlessWheel,
    "stick-slip": StickSlip,
    "two-tanks": TwoTanks,
}
"""Name -> class; the first is the default."""
