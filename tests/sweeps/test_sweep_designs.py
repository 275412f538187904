"""Points of a sweep: every design visits what it says, and every tile is visited once."""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from hybridsens.parameters import replace
from hybridsens.scenes import BouncingBall
from hybridsens.sweeps import batch, grid, latin_hypercube, random, saltelli, sobol
from hybridsens.sweeps.store import points_in, tile_shape, tiles

BOX = {"height": (1.0, 3.0), "weight": (5.0, 10.0)}


@settings(deadline=None, max_examples=50)
@given(st.lists(st.integers(1, 12), min_size=1, max_size=3), st.integers(1, 100))
def test_tiles_cover_every_point_once_and_stay_small(lengths, points):
    """Assert that tiles of any grid are a partition of it, none larger than asked for."""
    shape = {f"p{i}": n for i, n in enumerate(lengths)}
    visits = np.zeros(lengths, int)
    for tile in tiles(shape, tile_shape(shape, points)):
        visits[tuple(tile.values())] += 1
        assert points_in(tile) <= points
    assert (visits == 1).all()


def test_tiles_of_a_line_are_nearly_equal():
    """Assert that 10,000 points in chunks of 8192 become two equal tiles: the second is not mostly padding."""
    assert [points_in(tile) for tile in tiles({"point": 10_000}, tile_shape({"point": 10_000}, 8192))] == [5000, 5000]


def test_grid_blocks_are_the_points_of_meshgrid():
    """Assert that a block of a grid lists the same points, in the same order, as NumPy's meshgrid."""
    heights, weights = np.linspace(1, 2, 5), np.linspace(9, 10, 4)
    block = grid(BouncingBall(), {"height": heights, "weight": weights}).block(
        {"height": slice(1, 4), "weight": slice(0, 3)}
    )
    expected = np.meshgrid(heights[1:4], weights[:3], indexing="ij")
    np.testing.assert_array_equal(block["height"], expected[0].ravel())
    np.testing.assert_array_equal(block["weight"], expected[1].ravel())


def test_latin_hypercube_has_one_point_in_each_interval():
    """Assert that each parameter takes one value in each of n equal intervals."""
    design = latin_hypercube(BouncingBall(), BOX, 50)
    for name, (low, high) in BOX.items():
        cells = np.floor((design.columns[name] - low) / (high - low) * 50).astype(int)
        assert sorted(cells) == list(range(50))


def test_sobol_points_average_better_than_random_ones():
    """Assert that the mean of a smooth function over 1024 Sobol points is within 1e-4 of the integral."""

    def error(design):
        x, y = ((design.columns[name] - low) / (high - low) for name, (low, high) in BOX.items())
        return abs(np.mean(np.exp(x) * y**2) - (np.e - 1) / 3)

    assert error(sobol(BouncingBall(), BOX, 1024)) < 1e-4 < error(random(BouncingBall(), BOX, 1024))


def test_saltelli_blocks_differ_from_the_first_in_one_column():
    """Assert that block 2 + i has the columns of A, save column i, which is B's."""
    design = saltelli(BouncingBall(), BOX, 8)
    blocks = {name: column.reshape(4, 8) for name, column in design.columns.items()}
    for i, name in enumerate(BOX):
        for j in range(2):
            np.testing.assert_array_equal(blocks[name][2 + j], blocks[name][1 if i == j else 0])
        assert (blocks[name][0] != blocks[name][1]).all()


def test_replace_sets_leaves_and_entries():
    """Assert that nested leaves and entries of arrays are reached by name, and others stay as they are."""
    scene = {"mass": jnp.ones(3), "start": (jnp.array(1.0), jnp.array(2.0))}
    changed = replace(scene, {"mass[1]": 5.0, "start.1": 7.0})
    np.testing.assert_array_equal(changed["mass"], [1, 5, 1])
    assert [float(leaf) for leaf in changed["start"]] == [1, 7]


def test_a_batch_keeps_every_leaf_of_its_scenes():
    """Assert that scenes given with a leading axis come back one by one."""
    scenes = eqx.filter_vmap(lambda height: BouncingBall(height=height))(jnp.linspace(1, 2, 6))
    block = batch(scenes).block({"point": slice(2, 4)})
    np.testing.assert_allclose(block["height"], [1.4, 1.6], rtol=1e-15)
    np.testing.assert_array_equal(block["mass"], [1.0, 1.0])


@pytest.mark.parametrize(
    ("make", "words"),
    [
        (lambda scene: grid(scene, {"hight": [1.0]}), "must have one of the names .* Did you mean 'height'"),
        (lambda scene: grid(scene, {"wieght": [1.0]}), "must have one of the names .* Did you mean 'weight'"),
        (lambda scene: grid(scene, {"height": []}), "must be a list of finite numbers"),
        (lambda scene: grid(scene, {"height": (0.5, 0.9, 10)}), r"Write jnp.linspace\(0.5, 0.9, 10\), or "),
        (lambda scene: grid(scene, {"height[0]": [1.0]}), "must be named without an index"),
        (lambda scene: grid({"mass": jnp.ones(2)}, {"mass": [1.0]}), "must be named one by one"),
        (lambda scene: grid({"mass": jnp.ones(2)}, {"mass[2]": [1.0]}), "must be named one by one"),
        (lambda scene: random(scene, {"height": (2.0, 1.0)}, 4), "must be finite and increasing"),
        (lambda scene: sobol(scene, BOX, 100), "must be a power of two"),
        (lambda scene: random(scene, BOX, 0), "must be an integer >= 1"),
        (lambda scene: random(scene, BOX, True), "must be an integer >= 1"),
        (lambda scene: random(scene, {}, 4), "must have at least one parameter"),
        (lambda scene: latin_hypercube(scene, {}, 4), "must have at least one parameter"),
        (lambda scene: sobol(scene, {}, 4), "must have at least one parameter"),
        (lambda scene: saltelli(scene, {}, 4), "must have at least one parameter"),
        (lambda scene: batch(scene), "all have the same leading axis, .* 0 for no axis. Repeat along"),
        (lambda scene: batch({"a": jnp.ones(2), "gear": jnp.arange(3)}), "same leading axis, .* {'a': 2, 'gear': 3}"),
        (lambda scene: batch([scene, scene]), r"`jax.tree.map\(lambda .*, \*scenes\)` makes one"),
        (lambda scene: batch({"a": jnp.ones(2), "seed": jax.random.split(jax.random.key(0))}), "numbers, but 'seed'"),
    ],
)
def test_a_bad_design_says_what_it_must_have(make, words, unchecked):
    """Assert that names, bounds and numbers that do not fit are refused at once."""
    with pytest.raises(ValueError, match=words):
        make(BouncingBall())


@pytest.mark.parametrize(
    ("box", "error"),
    [(["height"], TypeError), ({"height": 1.0}, ValueError), ({"height": (1.0, 2.0, 3.0)}, ValueError)],
)
def test_a_box_must_be_a_mapping_to_pairs(unchecked, box, error):
    """Assert that names alone, or numbers alone, are answered with the form of a box."""
    with pytest.raises(error, match="must be (a mapping of parameters to lowest and highest values|two numbers)"):
        latin_hypercube(BouncingBall(), box, 4)


@pytest.mark.parametrize("make", [random, latin_hypercube, sobol, saltelli])
def test_integers_of_numpy_are_integers(make):
    """Assert that a number of points that comes out of an array serves."""
    assert make(BouncingBall(), BOX, np.int64(4)).size == make(BouncingBall(), BOX, 4).size


def test_a_batch_tells_its_integers_and_booleans_apart():
    """Assert that each of its scenes has its own, and that it prints."""
    scenes = {"a": jnp.ones(3), "gear": jnp.array([0, 1, 2]), "table": np.eye(3, dtype=int), "on": jnp.arange(3) > 1}
    design = batch(scenes)
    block = design.block({"point": slice(1, 3)})
    assert {name: column.tolist() for name, column in block.items()} == {
        "a": [1, 1], "gear": [1, 2], "table": [[0, 1, 0], [0, 0, 1]], "on": [False, True],
    }  # fmt: skip
    assert "on 0 to 1" in str(design)


def test_a_design_prints_as_a_line():
    """Assert that its points are told of, not listed."""
    design = grid(BouncingBall(), {"height": np.linspace(1, 2, 500), "weight": [9.0, 10.0]})
    assert str(design) == "Design(grid, 500 x 2 points of BouncingBall: height 1 to 2, weight 9 to 10)"


class Two(eqx.Module):
    """An array of parameters."""

    m: jax.Array


@pytest.mark.parametrize("design", [lambda scene, names: grid(scene, dict.fromkeys(names, [1.0])),
                                    lambda scene, names: sobol(scene, dict.fromkeys(names, (0.0, 1.0)), 4)],
                         ids=["grid", "sobol"])  # fmt: skip
def test_a_parameter_is_varied_once(design):
    """Two spellings of one entry: the later one would win, and the axis of the other do nothing."""
    with pytest.raises(ValueError, match=r"named once, but 'm\[0, 1\]' and 'm\[0,1\]' are one"):
        design(Two(jnp.zeros((1, 2))), ["m[0, 1]", "m[0,1]"])


def test_complex_values_are_refused():
    """Their imaginary part would be lost."""
    with pytest.raises(ValueError, match=r"values of 'm\[0, 1\]' must be real numbers, but are complex"):
        grid(Two(jnp.zeros((1, 2))), {"m[0, 1]": np.array([1.0, 2.0 + 1.0j])})
