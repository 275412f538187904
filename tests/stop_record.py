"""SciPy's record of the oscillator with a stop, the truth behind it, and guesses near it and far off."""

from pathlib import Path

from hybridsens.estimation import Measurements, read_measurements

RECORD = Path(__file__).parents[1] / "notebooks" / "data" / "stop_record.csv"
TRUTH = {
    "stiffness": 1.0, "damping": 0.1, "amplitude": 1.0, "frequency": 1.3, "distance": 0.6,
    "restitution_coefficient": 0.8,
}  # fmt: skip
NEAR = {
    "stiffness": 1.03, "damping": 0.11, "amplitude": 0.97, "frequency": 1.31, "distance": 0.62,
    "restitution_coefficient": 0.75,
}  # fmt: skip
FAR = {
    "stiffness": 0.7, "damping": 0.07, "amplitude": 1.3, "frequency": 0.95, "distance": 0.42,
    "restitution_coefficient": 0.95,
}  # fmt: skip
STOP = {
    "parameters": list(TRUTH), "robust": 2.0,
    "bounds": {name: "positive" for name in TRUTH} | {"restitution_coefficient": (0, 1)},
}  # fmt: skip


def stop_record() -> Measurements:
    """Positions at 200 times with noise of 1 % of the amplitude, 4 outliers, and two stretches without data."""
    return read_measurements(RECORD, missing="skip")
