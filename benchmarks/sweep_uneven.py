"""What a batch costs whose lanes have 3 to 300 events, against the sum of its lanes' own work.

    python -m benchmarks.sweep_uneven [--points 128]

Balls that bounce 3 to 300 times before the end, in random order. A lane's own work is the time of a batch of copies of
it alone, divided by their number: it waits for no other lane, and calls cost as little as in the mixed batch. The last
line is what waiting costs: the same batch with all lanes in step (`mapped=False`, as on an accelerator), on this
processor. Times are the processor's, the shortest of five.
"""

import argparse
import time

import hybridsens

hybridsens.configure()

import jax  # noqa: E402
import numpy as np  # noqa: E402

from benchmarks.sweep_problems import Ball  # noqa: E402
from hybridsens.sweeps.engine import Engine, Program  # noqa: E402
from hybridsens.sweeps.point import Wanted  # noqa: E402

HORIZON = 10.0


def cost(ball):
    """J = int q^2."""
    trajectory = hybridsens.simulate(
        ball,
        ball.start(),
        t1=HORIZON,
        running_cost=lambda s, t, q, v: q @ q,
        max_events=320,
        max_steps=4096,
        throw=False,
    )
    return trajectory.cost, trajectory


def columns(points: int) -> dict[str, np.ndarray]:
    """Balls with e = 1 that fall for HORIZON / (2 n) seconds at first, so bounce n times: n from 3 to 300."""
    bounces = np.geomspace(3, 300, points)
    fall = HORIZON / (2 * bounces)
    heights = np.random.default_rng(0).permutation(9.81 * fall**2 / 2)
    return {"q0": heights}


def main() -> None:
    """Print the comparison."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--points", type=int, default=128)
    points = parser.parse_args().points
    given = columns(points)
    program = Program(cost, Ball(g=9.81, e=1.0), Wanted(("q0", "v0", "g", "e"), 0, False))
    engine, lockstep = (Engine(program, points, jax.devices()[:1], mapped) for mapped in (True, False))
    results = engine.run(given)
    np.testing.assert_allclose(lockstep.run(given)["dJ_dg"], results["dJ_dg"], rtol=1e-6)
    together = seconds(lambda: engine.run(given))
    waiting = seconds(lambda: lockstep.run(given))
    copies = [{"q0": np.full(points, height)} for height in given["q0"]]
    own = sum(seconds(lambda same=same: engine.run(same)) for same in copies) / points
    counts = results["event_count"]
    failed = int((results["status"] != 0).sum())
    print(f"{points} lanes with {counts.min()} to {counts.max()} events, {counts.sum()} in all; {failed} failed")
    print(f"sum of the lanes' own work {own:8.4f} s")
    print(f"one batch of them all      {together:8.4f} s = {together / own:.2f} of it")
    print(f"the same, all in step      {waiting:8.4f} s = {waiting / own:.2f} of it")


def seconds(call) -> float:
    """Shortest of five processor times (one device runs in the calling thread)."""
    times = []
    for _ in range(5):
        start = time.process_time()
        call()
        times.append(time.process_time() - start)
    return min(times)


if __name__ == "__main__":
    main()
