"""Records of the oscillator with a stop by SciPy's integrator and events, their truth, and guesses near and far off.

Nothing of hybridsens takes part in the records.
"""

from collections.abc import Callable, Mapping
from pathlib import Path

import numpy as np
from scipy.integrate import solve_ivp

from hybridsens.estimation import Measurements, read_measurements

RECORD = Path(__file__).parents[2] / "notebooks" / "data" / "stop_record.csv"
TRUTH = {
    "stiffness": 1.0, "damping": 0.1, "amplitude": 1.0, "frequency": 1.3, "distance": 0.6,
    "restitution_coefficient": 0.8,
}  # fmt: skip
BOUNDS = {name: "positive" for name in TRUTH} | {"restitution_coefficient": (0, 1)}
TIMES = np.linspace(0.1, 20.0, 200)
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
    "bounds": BOUNDS,
}  # fmt: skip


def stop_record() -> Measurements:
    """Positions at 200 times with noise of 1 % of the amplitude, 4 outliers, and two stretches without data."""
    return read_measurements(RECORD, missing="skip")


def positions(
    p: Mapping[str, float] = TRUTH, times: np.ndarray = TIMES, drive: Callable[[float], float] | None = None
) -> tuple[np.ndarray, list[float]]:
    """Positions of q'' = -k q - c q' + drive(t), q <= d, at these times, and the times of the impacts; by default
    drive(t) = A cos(Omega t)."""
    push = drive or (lambda t: p["amplitude"] * np.cos(p["frequency"] * t))

    def rates(t, x):
        return [x[1], -p["stiffness"] * x[0] - p["damping"] * x[1] + push(t)]

    def gap(t, x):
        return p["distance"] - x[0]

    gap.terminal, gap.direction = True, -1  # type: ignore[attr-defined]
    t, x, impacts, q = 0.0, np.zeros(2), [], np.zeros(times.size)
    while t < times[-1]:
        flight = solve_ivp(
            rates, (t, times[-1]), x, method="DOP853", events=gap, dense_output=True, rtol=1e-12, atol=1e-12
        )
        seen = (times >= t) & (times <= flight.t[-1])
        q[seen] = flight.sol(times[seen])[0]
        t, x = flight.t[-1], flight.y[:, -1] * [1, -p["restitution_coefficient"]]
        if flight.status == 1:
            impacts.append(float(t))
            x[0] = p["distance"] - 1e-13  # just off the stop, or the next flight would start with an event
    return q, impacts
