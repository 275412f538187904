"""An elastic ball over any number of impacts: energy, event times and gradient in closed form."""

import math

import numpy as np

import hybridsens as hs
from hybridsens.scenes import BouncingBall

GRAVITY = 9.81


def exact_slope(impacts: int, horizon: float) -> float:
    """d q(T)/d q0 of an elastic ball dropped from q0 = 1, after so many impacts.

    t_1 = sqrt(2 q0/g), impact k at (2k - 1) t_1 with speed w = sqrt(2 g q0); q(T) = w s - g s^2/2 with
    s = T - (2k - 1) t_1.
    """
    t1, w = math.sqrt(2 / GRAVITY), math.sqrt(2 * GRAVITY)
    s, ds = horizon - (2 * impacts - 1) * t1, -(2 * impacts - 1) * t1 / 2
    return w / 2 * s + w * ds - GRAVITY * s * ds


def final_height_of(count: int, horizon: float):
    """Where the ball is at the horizon, as a function of the height that it is dropped from, and its motion."""

    def final_height(height):
        scene = BouncingBall(height=height, restitution_coefficient=1.0)
        motion = hs.simulate(
            scene, scene.initial_state(), t1=horizon, max_events=count + 2, max_steps=6 * count, throw=False
        )
        return motion.final.q[0], motion

    return final_height


def chain_errors(motion: hs.Trajectory, count: int) -> dict[str, float]:
    """Relative errors of an elastic ball dropped from 1: t_k = (2 k - 1) sqrt(2 / g), v^2 / (2 g) + q = 1."""
    happened = int(motion.events.count)
    times = np.asarray(motion.events.time[:happened])
    exact = (2 * np.arange(1, happened + 1) - 1) * np.sqrt(2 / GRAVITY)
    after = motion.events.after
    energies = np.asarray(after.v[:happened, 0]) ** 2 / (2 * GRAVITY) + np.asarray(after.q[:happened, 0])
    return {
        "impacts missed or made up": abs(happened - count),
        "event times, relative": np.max(np.abs(times / exact - 1)),
        "energy drift, relative": np.max(np.abs(energies - 1)),
    }
