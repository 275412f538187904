"""Bodies in a row and a plate on feet: mass ratios, impacts at one instant, redundant contacts."""

import jax.numpy as jnp
import numpy as np
import pytest

import hybridsens as hs
from tests.closeness import assert_close
from tests.problems.flat_contacts import GRAVITY, TABLES, balls, make, plate, run


@pytest.mark.parametrize("ratio", [1e-8, 1e-4, 1.0, 1e4, 1e8])
def test_two_bodies_of_any_mass_ratio_collide_by_the_textbook(ratio):
    """Momentum is kept and the relative speed reversed times e, to rounding, for mass ratios 1e-8 to 1e8."""
    trajectory = run(balls(2, 0.7, [1.0, ratio]), [0.0, 2.0], [1.0, 0.0], 2.0)
    common = 1 / (1 + ratio)
    expected = common + 0.7 / (1 + ratio) * np.array([-ratio, 1.0])
    assert trajectory.events.count == 1
    assert_close(trajectory.final.v, expected, 1e-14)
    assert_close(trajectory.final.q, np.array([1.0, 2.0]) + expected, 1e-14)


@pytest.mark.parametrize(
    "ratio, collisions", [pytest.param(1e2, 31, marks=pytest.mark.slow), pytest.param(1e4, 314, marks=pytest.mark.slow)]
)
def test_a_light_ball_between_a_wall_and_a_heavy_one_counts_the_digits_of_pi(ratio, collisions):
    """Elastic collisions number floor(pi sqrt(ratio)), and energy is kept to 1e-13."""
    scene = make([1.0, ratio], [0.0, 0.0], [[1.0, 0.0], [-1.0, 1.0]], [0.0, 0.0], [1.0, 1.0])
    trajectory = run(scene, [1.0, 2.0], [0.0, -1.0], 10.0)
    assert trajectory.events.count == collisions
    assert_close(trajectory.final.v**2 @ scene.mass, np.array(ratio), 1e-13)


@pytest.mark.slow
@pytest.mark.parametrize("e", [1.0, 0.5])
def test_a_row_of_touching_balls_obeys_the_simultaneous_law(e):
    """All four contacts strike at once: only the first opens, the struck balls move on together (T3)."""
    trajectory = run(balls(5, e), [-0.5, 1.0, 2.0, 3.0, 4.0], [1.0, 0.0, 0.0, 0.0, 0.0], 3.0)
    together = (1 + e) / 5
    assert trajectory.status == hs.Status.successful and trajectory.events.count == 1
    assert_close(trajectory.final.v, np.array([together - e, *[together] * 4]), 1e-14)


@pytest.mark.slow
def test_a_row_of_balls_a_billionth_apart_hands_the_impact_on():
    """With gaps of 1e-9 the impacts come one after the other, and only the last ball leaves (Newton's cradle)."""
    places = [-0.5, *(1 + 1e-9) * np.arange(4) + 1]
    trajectory = run(balls(5, 1.0), places, [1.0, 0.0, 0.0, 0.0, 0.0], 3.0)
    assert list(trajectory.events.contact[:4]) == [0, 1, 2, 3] and trajectory.events.count == 4
    assert_close(trajectory.final.v, np.array([0.0, 0.0, 0.0, 0.0, 1.0]), 1e-14)


@pytest.mark.slow
@pytest.mark.parametrize("floor", [0.0, 1.0])
@pytest.mark.parametrize("e", [0.0, 0.5])
@pytest.mark.parametrize("table", ["four feet", "three feet"])
def test_a_plate_dropped_flat_stays_flat_and_rests(table, e, floor):
    """Redundant feet, exact and near copies among them, strike at once: no tilt, no penetration, rest."""
    trajectory = run(plate(TABLES[table], e, floor), [1.0 + floor, 0.0, 0.0], [0.0, 0.0, 0.0], 2.0)
    assert trajectory.status == hs.Status.successful and bool(jnp.any(trajectory.mode))
    assert_close(trajectory.final.q, np.array([floor, 0.0, 0.0]), 1e-12, scale=1.0)
    assert_close(trajectory.final.v, np.zeros(3), 1e-12, scale=1.0)


@pytest.mark.slow
@pytest.mark.parametrize("table", ["four feet", "three feet"])
def test_a_plate_dropped_flat_and_elastic_bounces_flat(table):
    """With e = 1 the plate goes up as it came: the closed form of one ball."""
    trajectory = run(plate(TABLES[table], 1.0), [1.0, 0.0, 0.0], [0.0, 0.0, 0.0], 0.8)
    fall = np.sqrt(2 / GRAVITY)
    flight = 0.8 - fall
    expected = GRAVITY * fall * flight - GRAVITY * flight**2 / 2
    assert trajectory.events.count == 1
    assert_close(trajectory.final.q, np.array([expected, 0.0, 0.0]), 1e-13)


@pytest.mark.slow
@pytest.mark.parametrize("e", [0.0, 0.5])
def test_a_plate_dropped_tilted_on_four_feet_comes_to_rest(e):
    """Its feet strike and kick each other off until all are down; nothing is left of tilt or speed."""
    trajectory = run(plate(TABLES["four feet"], e), [1.0, 0.1, 0.07], [0.0, 0.0, 0.0], 6.0)
    assert trajectory.status == hs.Status.successful
    assert_close(trajectory.final.q, np.zeros(3), 1e-10, scale=1.0)
    assert_close(trajectory.final.v, np.zeros(3), 1e-10, scale=1.0)
