"""What a batch costs whose lanes have 3 to 300 events, against the sum of its lanes' own work.

    python -m benchmarks.sweep_uneven [--points 128]

Balls that bounce 3 to 300 times before the end, in random order. Lanes' own work: each lane alone, by the same compiled
one-lane program. For comparison all lanes in step (vmapped), as they would run without mapping.
"""

import argparse
import time

import hybridsens

hybridsens.configure()

import jax  # noqa: E402
import numpy as np  # noqa: E402

from benchmarks.sweep_problems import Ball  # noqa: E402
from hybridsens.study.sweep.engine import Engine, Program  # noqa: E402
from hybridsens.study.sweep.lane import Wanted  # noqa: E402

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
    one = jax.devices()[:1]
    alone, mapped, vmapped = (
        Engine(program, size, one, how) for size, how in ((1, True), (points, True), (points, False))
    )
    lanes = [{"q0": given["q0"][i : i + 1]} for i in range(points)]
    results, together = mapped.run(given), seconds(lambda: mapped.run(given))
    alone.run(lanes[0])
    own = sum(seconds(lambda lane=lane: alone.run(lane)) for lane in lanes)
    call = seconds(lambda: alone.run(lanes[int(np.argmin(results["event_count"]))]))
    vmapped.run(given)
    in_step = seconds(lambda: vmapped.run(given))
    counts = results["event_count"]
    failed = int((results["status"] != 0).sum())
    print(f"{points} lanes with {counts.min()} to {counts.max()} events, {counts.sum()} in all; {failed} failed")
    print(f"sum of the lanes' own work {own:8.3f} s (the shortest lane's call: {1e3 * call:.2f} ms)")
    print(f"one mapped batch           {together:8.3f} s = {together / own:.2f} of it")
    print(f"one vmapped batch          {in_step:8.3f} s = {in_step / own:.2f} of it")


def seconds(call) -> float:
    """Shortest of three times."""
    times = []
    for _ in range(3):
        start = time.perf_counter()
        call()
        times.append(time.perf_counter() - start)
    return min(times)


if __name__ == "__main__":
    main()
