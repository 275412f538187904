"""The shipped scenes in the parameters of the reference problems, and a ball in those of the published ones."""

import json
from pathlib import Path

import motions

from hybridsens.scenes import BouncingBall, CylinderSlide, ElasticStop, StackedBalls

RECORDS = json.loads(Path(__file__).with_name("references.json").read_text())
"""The reference problems' digits: 25 to 30 places from closed forms, gradients included."""


def bouncing_ball(q0, v0, g, e):
    """P1: a ball of unit mass."""
    return BouncingBall(height=q0, velocity=v0, weight=g, restitution_coefficient=e)


def elastic_stop(omega, zeta, A, Omega, d, e):
    """P2 and P2b: q'' = -omega^2 q - 2 zeta omega q' + A cos(Omega t), stop at d."""
    return ElasticStop(1.0, omega**2, 2 * zeta * omega, A, Omega, d, e)


def cylinder_slide(R, g, theta0, e):
    """P3: a point mass at rest at theta0 from the top of a cylinder; the floor is at -R."""
    return CylinderSlide(radius=R, angle=theta0, weight=g, depth=R, restitution_coefficient=e)


def stacked_balls(m1, m2, e1, e2, g):
    """P4: a ball of mass m2 above one of mass m1."""
    return StackedBalls(m1, m2, m1 * g, m2 * g, restitution_floor=e1, restitution_balls=e2)


def solve_with_gradient(scene_of, p, t1, tolerance):
    """What is observed of the scene made from p, its Jacobian by p, and the trajectory."""
    seen, jacobian, trajectory = motions.solve(scene_of(*p), tolerance, t1)
    return seen, motions.chain(jacobian, lambda p: (scene_of(*p), t1), p), trajectory
