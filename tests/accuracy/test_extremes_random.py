"""Fifty scenes at random (up to four coordinates and contacts): the laws of motion and impact, and three ways to a
gradient."""

import numpy as np
import pytest

import hybridsens as hs
from tests.problems import scenes_at_random as at_random
from tests.problems.laws import violations

SMALL = dict.fromkeys(["penetration", "gap at its event"], 1e-9) | dict.fromkeys(
    ["order of events", "impulse balance", "growth of energy"], 1e-12
) | {"negative impulse": 5e-5}
"""What rounding leaves; other laws may be off by the speed at which a cascade of impacts is cut, 6e-6, and impulses
that bring several contacts to rest by a few times that."""
CUT = 1e-5


TOLD = (2174, 2708, 3349, 6942, 7072, 7259, 1960, 2589, 4633, 5285, 5421, 5978, 6159, 6236, 7391)
"""Among ten thousand scenes, some whose contacts pulled each other closed as they were brought to rest, or were met by
a moving wall while nothing moved: the event came again at once. And some whose contacts kicked each other off in turn,
by less than rounding, for ever."""


@pytest.mark.slow
@pytest.mark.parametrize("seed", [*range(50), *TOLD])
def test_a_random_motion_obeys_the_laws(seed):
    """No penetration, impulses that balance and do not pull, Newton's law, no energy gained, events in order; and it
    ends as it should."""
    given = at_random.draw(seed)
    motion = at_random.move(*given)
    endless = given.elastic and motion.status == hs.Status.max_events_reached
    assert motion.status in (hs.Status.successful, hs.Status.grazing) or endless, hs.Status[motion.status]
    for law, size in violations(given, motion).items():
        assert size <= SMALL.get(law, CUT), law


@pytest.mark.slow
@pytest.mark.parametrize("seed", [827, 2600, 3279, 4135, 4624, 6554])
def test_what_only_rounding_depends_on_keeps_no_gradient_from_its_end(seed):
    """Damping of a body that is held still, say. Where a sweep back began with it, steps were cut until none was left,
    and the gradient was nan."""
    given = at_random.draw(seed)
    forward, reverse = at_random.slopes(given, at_random.random_direction(given, np.random.default_rng(seed)))
    assert abs(forward - reverse) <= 1e-12 * (1 + abs(forward))


@pytest.mark.slow
@pytest.mark.parametrize("seed", range(0, 50, 5))
def test_forward_and_reverse_agree_on_a_random_scene_and_differences_where_they_may(seed):
    """Along a random direction in scene and state, and along the load by differences, if no event comes or goes."""
    given = at_random.draw(seed)
    if at_random.move(*given).status != hs.Status.successful:
        return
    direction = at_random.random_direction(given, np.random.default_rng(seed))
    forward, reverse = at_random.slopes(given, direction)
    assert abs(forward - reverse) <= 1e-9 * (1 + abs(forward))
    direction = at_random.load_alone(given, direction)
    difference = at_random.difference_slope(given, direction, 1e-5)
    if difference is not None:
        assert abs(at_random.slopes(given, direction)[0] - difference) <= 1e-4 * (1 + abs(difference))


@pytest.mark.slow
@pytest.mark.parametrize("trivial", [at_random.at_rest, at_random.in_flight], ids=["at-rest", "in-flight"])
@pytest.mark.parametrize("seed", range(1, 50, 6))
def test_gradients_of_trivial_motions_are_those_of_differences(seed, trivial):
    """From equilibrium and in flight the motion needs hardly a step; its derivative does."""
    given = trivial(at_random.draw(seed))
    direction = at_random.load_and_state(given, np.random.default_rng(seed))
    difference = at_random.difference_slope(given, direction, 1e-3 if trivial is at_random.at_rest else 1e-5)
    if difference is None:
        return
    for slope in at_random.slopes(given, direction):
        assert abs(slope - difference) <= 1e-5 * (1 + abs(difference))
