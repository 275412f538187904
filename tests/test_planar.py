"""Gaps of bodies in a plane are distances, smooth at touch, and can be bounded inside a step."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from hybridsens import planar
from hybridsens.interval.breaks import breaks
from hybridsens.interval.kind import Kind
from hybridsens.search.gap_search import gap_kinds

SQUARE = jnp.array([[-1.0, -1.0], [1.0, -1.0], [1.0, 1.0], [-1.0, 1.0]])
RADIUS = 0.3
OUTSIDE = {
    "half plane": lambda x: planar.to_half_plane(x, [0.0, 1.0], [1.0, 2.0], RADIUS),
    "disc": lambda x: planar.to_disc(x, [0.5, 0.2], 1.1, RADIUS),
    "segment": lambda x: planar.to_segment(x, [-1.0, -0.5], [1.0, 0.7], RADIUS),
    "polygon": lambda x: planar.to_polygon(x, SQUARE, RADIUS),
}


def _boundary(name: str) -> np.ndarray:
    """Points on the obstacle, densely: an independent truth for the distance to it."""
    s = np.linspace(0, 1, 20001)[:, None]
    between = lambda a, b: (1 - s) * np.asarray(a) + s * np.asarray(b)
    if name == "half plane":
        return between([-60.0, 31.0], [60.0, -29.0])
    if name == "disc":
        return planar.circle([0.5, 0.2], 1.1, 20000)
    if name == "segment":
        return between([-1.0, -0.5], [1.0, 0.7])
    return np.concatenate([between(SQUARE[i - 1], SQUARE[i]) for i in range(4)])


@pytest.mark.parametrize("name", OUTSIDE)
def test_a_gap_from_outside_is_the_distance(name):
    """To the nearest of many points of the obstacle, less the radius; and its gradient has length 1."""
    points = np.random.default_rng(2).normal(size=(60, 2)) * 4 + 2
    gaps = OUTSIDE[name](jnp.asarray(points))
    distance = np.linalg.norm(points[:, None] - _boundary(name), axis=-1).min(axis=1) - RADIUS
    outside = np.asarray(gaps) > 0.01
    assert outside.sum() > 20
    np.testing.assert_allclose(gaps[outside], distance[outside], atol=1e-4)
    slopes = jax.vmap(jax.grad(OUTSIDE[name]))(jnp.asarray(points[outside]))
    np.testing.assert_allclose(np.linalg.norm(slopes, axis=1), 1, rtol=1e-12)


@pytest.mark.parametrize("name", OUTSIDE)
def test_gaps_have_bounds_inside_a_step(name):
    """No operation in them is unknown to interval arithmetic, so that dips are searched for and not sampled."""
    kinds, _ = gap_kinds(lambda t, q: OUTSIDE[name](q)[None], jnp.zeros(()), jnp.array([3.0, 3.0]))
    assert kinds.max() < Kind.UNKNOWN


def test_walls_of_a_room_are_a_gap_each():
    """Inside a square; one wall after the other, from the corner where it begins."""
    gaps = planar.inside_polygon(jnp.array([0.2, -0.3]), SQUARE, 0.1)
    np.testing.assert_allclose(gaps, [0.6, 0.7, 1.2, 1.1], rtol=1e-14)
    assert planar.inside_polygon(jnp.zeros((5, 2)), SQUARE).shape == (5, 4)


def test_the_gap_inside_a_disc_is_smooth_at_its_centre():
    """And 0 with slope -1 along the radius where the rim is touched."""
    gap = lambda x: planar.inside_disc(x, [1.0, 0.0], 2.0, 0.5)
    np.testing.assert_allclose(jax.grad(gap)(jnp.array([1.0, 0.0])), [0, 0], atol=1e-15)
    touching = jnp.array([1.0 + 1.5 * np.cos(0.4), 1.5 * np.sin(0.4)])
    np.testing.assert_allclose(gap(touching), 0, atol=1e-15)
    np.testing.assert_allclose(jax.grad(gap)(touching), [-np.cos(0.4), -np.sin(0.4)], rtol=1e-14)


def test_the_gap_of_a_disc_turns_smoothly_round_a_corner():
    """The slope is continuous where the nearest point of a polygon comes to its corner."""
    slope = jax.grad(OUTSIDE["polygon"])
    before, after = slope(jnp.array([1.0 - 1e-9, 1.4])), slope(jnp.array([1.0 + 1e-9, 1.4]))
    np.testing.assert_allclose(before, after, atol=1e-8)


def test_points_of_a_body_move_with_it():
    """`place` turns counter-clockwise, and `velocity` is its rate: that of a rigid body."""
    corner = jnp.array([[0.5, 0.0]])
    point = lambda q: planar.place(corner, q[:2], q[2])
    np.testing.assert_allclose(point(jnp.array([1.0, 2.0, np.pi / 2])), [[1.0, 2.5]], atol=1e-15)
    turning = planar.velocity(point, jnp.array([1.0, 2.0, np.pi / 2]), jnp.array([0.1, 0.2, 3.0]))
    np.testing.assert_allclose(turning, [[0.1 - 1.5, 0.2]], atol=1e-15)


@pytest.mark.parametrize("gap", [planar.to_segment, planar.to_polygon])
def test_a_point_has_no_smooth_gap_at_a_corner(gap):
    """A radius of 0 is refused."""
    with pytest.raises(ValueError, match="must be positive"):
        gap(jnp.zeros(2), *([SQUARE] if gap is planar.to_polygon else [SQUARE[0], SQUARE[1]]), 0.0)


@pytest.mark.parametrize(
    "gap",
    [
        lambda x: planar.to_segment(x.reshape(2, 2), SQUARE[0], SQUARE[1], RADIUS),
        lambda x: planar.to_polygon(x[:2], SQUARE, RADIUS),
    ],
    ids=["segment", "polygon"],
)
def test_no_gap_looks_kinked(gap):
    """A distance has a derivative where the nearest point changes, and so its trace is told of nothing."""
    assert not breaks(jax.make_jaxpr(gap)(jnp.full(4, 3.0)), ["q"])
