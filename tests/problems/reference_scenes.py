"""The reference problems with this package: the ready-made scenes in the references' parameters."""

import hybridsens as hs
from hybridsens.scenes import BouncingBall, CylinderSlide, ElasticStop, StackedBalls
from tests.problems import references


def bouncing_ball(q0, v0, g, e):
    """P1: unit mass."""
    return BouncingBall(height=q0, velocity=v0, weight=g, restitution_coefficient=e)


def elastic_stop(omega, zeta, A, Omega, d, e):
    """P2 and P2b: q'' = -omega^2 q - 2 zeta omega q' + A cos(Omega t)."""
    return ElasticStop(1.0, omega**2, 2 * zeta * omega, A, Omega, d, e)


def cylinder_slide(R, g, theta0, e):
    """P3: unit mass, floor at -R."""
    return CylinderSlide(radius=R, angle=theta0, weight=g, depth=R, restitution_coefficient=e)


def stacked_balls(m1, m2, e1, e2, g):
    """P4: m2 above m1."""
    return StackedBalls(m1, m2, m1 * g, m2 * g, restitution_floor=e1, restitution_balls=e2)


SCENES = {
    "P1": (bouncing_ball, 2.0, None),
    "P2": (elastic_stop, 20.0, None),
    "P2b": (elastic_stop, 20.0, None),
    "P3": (cylinder_slide, 2.5, 0),
    "P4": (stacked_balls, 1.5, 1),
}
"""Name -> scene of the parameters, horizon, and which coordinate at the end is the functional (None: int q^2)."""


def squared(scene, t, q, v):
    """Running cost of P1 and P2."""
    return q @ q


def cost(problem: str, parameters, tolerance: float, adjoint=None):
    """The functional of the reference, by this package."""
    scene_of, horizon, coordinate = SCENES[problem]
    scene = scene_of(*parameters)
    motion = hs.simulate(
        scene, scene.initial_state(), t1=horizon, running_cost=squared if coordinate is None else None,
        rtol=tolerance, atol=tolerance, max_events=references.load(problem).event_count + 3, max_steps=2048,
        adjoint=adjoint, throw=False,
    )  # fmt: skip
    return motion.cost if coordinate is None else motion.final.q[coordinate]
