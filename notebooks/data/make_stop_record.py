"""Make `stop_record.csv`: what a sensor might have seen of the elastic stop, by SciPy's integrator and events.

Nothing of hybridsens takes part in it. Noise of 1 % of the amplitude, 4 outliers, two stretches without data.

Run: python notebooks/data/make_stop_record.py
"""

from pathlib import Path

import numpy as np
from scipy.integrate import solve_ivp

MASS, STIFFNESS, DAMPING, AMPLITUDE, FREQUENCY, DISTANCE, RESTITUTION = 1.0, 1.0, 0.1, 1.0, 1.3, 0.6, 0.8
TIMES = np.linspace(0.1, 20.0, 200)


def rates(t, x):
    """(q, v)' of the oscillator in flight."""
    return [x[1], (-STIFFNESS * x[0] - DAMPING * x[1] + AMPLITUDE * np.cos(FREQUENCY * t)) / MASS]


def closing(t, x):
    """Falls through zero where the mass meets the stop."""
    return DISTANCE - x[0]


closing.terminal = True
closing.direction = -1


def true_positions() -> tuple[np.ndarray, list[float]]:
    """Positions at TIMES, and the times of the impacts."""
    t, x, impacts = 0.0, np.zeros(2), []
    q = np.zeros(TIMES.size)
    while t < TIMES[-1]:
        flight = solve_ivp(
            rates, (t, TIMES[-1]), x, method="DOP853", events=closing, dense_output=True, rtol=1e-12, atol=1e-12
        )
        seen = (TIMES >= t) & (TIMES <= flight.t[-1])
        q[seen] = flight.sol(TIMES[seen])[0]
        t, x = flight.t[-1], flight.y[:, -1] * [1, -RESTITUTION]
        if flight.status == 1:
            impacts.append(t)
            x[0] = DISTANCE - 1e-13  # just off the stop, or the next flight would start with an event
    return q, impacts


def main() -> None:
    random = np.random.default_rng(20)
    q, _ = true_positions()
    sigma = 0.01 * np.max(np.abs(q))
    seen = q + sigma * random.normal(size=q.size)
    seen[[23, 77, 120, 171]] += 15 * sigma * np.array([1, -1, 1, -1])
    seen[50:58] = np.nan
    seen[140:150] = np.nan
    rows = [f"{t:.4f},{'' if np.isnan(y) else f'{y:.6f}'},{sigma:.6f}" for t, y in zip(TIMES, seen, strict=True)]
    path = Path(__file__).parent / "stop_record.csv"
    path.write_text("# synthetic record of an oscillator with a stop, made by make_stop_record.py\nt,q,sigma_q\n"
                    + "\n".join(rows) + "\n")  # fmt: skip


if __name__ == "__main__":
    main()
