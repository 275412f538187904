"""Ready-made scenes draw themselves: where a gap is closed, outlines touch, and elsewhere they do not."""

import inspect

import jax.numpy as jnp
import numpy as np
import pytest
from scipy.spatial import KDTree

from hybridsens import planar, scenes
from hybridsens.export.names import coordinate_names, split_unit
from hybridsens.scenes.shipped import ShippedScene

TOUCHING = {
    scenes.BouncingBall: [0.0],
    scenes.VibratingTable: [0.02 * np.sin(31.41592653589793 * 0.02)],
    scenes.ElasticStop: [0.6],
    scenes.ChainOfMasses: [0.3, -0.3, 0.0, 0.0],
    scenes.NewtonsCradle: [0.0, 0.0, 1e-3, 0.0, 0.0],
    scenes.StackedBalls: [0.7, 0.7],
    scenes.CylinderSlide: [0.6, 0.8],
    scenes.PendulumWall: [np.arcsin(0.2)],
    scenes.DoublePendulumWall: [0.0, np.arcsin(0.5 / 0.7)],
    scenes.LinkPendulum: [0.0, np.arcsin(0.75), 0.0],
    scenes.BallsInBox: [0.0, 0.0, 0.2, 0.0, 1.0, 1.0],
}
"""Configurations in which one gap is 0 (of the table at t = 0.02)."""
STARTS_APART = (
    scenes.BouncingBall, scenes.ElasticStop, scenes.ChainOfMasses, scenes.StackedBalls, scenes.PendulumWall,
    scenes.DoublePendulumWall, scenes.LinkPendulum, scenes.BallsInBox,
)  # fmt: skip
APART = 0.02
"""By how much outlines are apart in the initial state, at least, where it touches nothing [m]."""


def _outlines(scene, q, t=0.02):
    """Dense points of each outline."""
    takes_time = "t" in inspect.signature(scene.draw).parameters
    found = scene.draw(jnp.asarray(q), t) if takes_time else scene.draw(jnp.asarray(q))
    along = np.linspace(0, 1, 200)[:, None]
    dense = lambda line: np.concatenate([a + along * (b - a) for a, b in zip(line[:-1], line[1:], strict=True)])
    return [dense(np.asarray(line)) for line in found]


def _distance(outlines):
    """Of the two nearest outlines."""
    pairs = [(a, b) for i, a in enumerate(outlines) for b in outlines[i + 1 :]]
    return min(np.min(KDTree(a).query(b)[0]) for a, b in pairs)


@pytest.mark.parametrize("kind", TOUCHING, ids=lambda kind: kind.__name__)
def test_outlines_touch_where_a_gap_is_closed(kind):
    """To a hundredth of a metre; a point on the cylinder lies at the middle of its circle."""
    scene = kind()
    gaps = np.asarray(scene.gap(jnp.asarray(0.02), jnp.asarray(TOUCHING[kind])))
    assert np.min(np.abs(gaps)) < 1e-12 and np.all(gaps > -1e-12)
    assert _distance(_outlines(scene, TOUCHING[kind])) < (0.031 if kind is scenes.CylinderSlide else 0.01)
    if kind in STARTS_APART:
        assert _distance(_outlines(scene, scene.initial_state().q)) > APART


def test_scenes_of_the_plane_draw_themselves():
    """All but the block on feet, which moves in space."""
    kinds = {kind for kind in vars(scenes).values() if isinstance(kind, type) and issubclass(kind, ShippedScene)}
    kinds -= {ShippedScene}
    assert {kind for kind in kinds if hasattr(kind, "draw")} == set(TOUCHING) == kinds - {scenes.FootedBlock}


def test_links_hang_from_the_origin():
    """A straight one downward, then a right angle to the right."""
    np.testing.assert_allclose(planar.links([0.0, np.pi / 2], [2.0, 1.0]), [[0, 0], [0, -2], [1, -2]], atol=1e-15)
    assert planar.rectangle([0.0, 1.0], [2.0, 3.0]).tolist() == [[0, 1], [2, 1], [2, 3], [0, 3], [0, 1]]


@pytest.mark.parametrize("kind", [*TOUCHING, scenes.FootedBlock], ids=lambda kind: kind.__name__)
def test_coordinates_have_names_with_units(kind):
    """As many as there are; by these tables, pictures and the units of measurements are told."""
    scene = kind()
    names, rates = coordinate_names(scene, scene.initial_state().q.shape[0])
    assert all(split_unit(name)[1] for name in (*names, *rates))
