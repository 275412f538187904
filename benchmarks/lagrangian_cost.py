"""What it costs to write a scene as energies: motion and gradient against the same scene written by hand.

Run as `python -m benchmarks.lagrangian_cost`. Both are timed in turns, and the least of each is told.
"""

import time

import equinox as eqx
import jax

import hybridsens as hs
from tests.problems.energies import PAIRS, as_energies


def motion(scene):
    """Sum of the final coordinates."""
    return hs.simulate(scene, scene.initial_state(), t1=scene.t1 if hasattr(scene, "t1") else 3.0).final.q.sum()


def compiled(function, scene):
    """The compiled function, and the seconds that its compilation took."""
    start = time.perf_counter()
    program = eqx.filter_jit(function).lower(scene).compile()
    return program, time.perf_counter() - start


def least_times(programs, scenes, rounds=200):
    """Least time of each program [s], taken in turns."""
    least = [float("inf")] * len(programs)
    for _ in range(rounds):
        for k, (program, scene) in enumerate(zip(programs, scenes, strict=True)):
            start = time.perf_counter()
            jax.block_until_ready(program(scene))
            least[k] = min(least[k], time.perf_counter() - start)
    return least


def main():
    hs.configure()
    for by_hand, energies in PAIRS:
        scenes = [by_hand(), as_energies(energies, by_hand())]
        energies.t1 = by_hand.t1
        for label, function in (("motion", motion), ("gradient", eqx.filter_grad(motion))):
            programs, seconds = zip(*(compiled(function, scene) for scene in scenes), strict=True)
            hand, energy = least_times(programs, scenes)
            print(
                f"{by_hand.__name__:>20} {label:>8}: {1e6 * hand:6.0f} us by hand, {1e6 * energy:6.0f} us of energies, "
                f"ratio {energy / hand:.2f}; compilation {seconds[0]:.1f} s and {seconds[1]:.1f} s"
            )


if __name__ == "__main__":
    main()
