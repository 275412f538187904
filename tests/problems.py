"""The digits of the reference problems, and what is differentiated to meet them."""

import json
from pathlib import Path

import motions

RECORDS = json.loads(Path(__file__).with_name("references.json").read_text())
"""The reference problems' digits: 25 to 30 places from closed forms, gradients included."""


def solve_with_gradient(scene_of, p, t1, tolerance):
    """What is observed of the scene made from p, its Jacobian by p, and the trajectory."""
    seen, jacobian, trajectory = motions.solve(scene_of(*p), tolerance, t1)
    return seen, motions.chain(jacobian, lambda p: (scene_of(*p), t1), p), trajectory
