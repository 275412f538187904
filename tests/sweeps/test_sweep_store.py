"""A sweep that is killed goes on where it was, and never mixes with another one."""

import contextlib
import os
import shutil
import signal
import subprocess
import sys
import time

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
import xarray as xr
import zarr

from hybridsens.sweeps import grid, random, status_counts, store, sweep
from hybridsens.sweeps.engine import Engine

SCENE = {"a": jnp.array(1.0), "b": jnp.array(2.0)}
TILES = 40

SCRIPT = """
import sys, numpy as np, xarray as xr
import hybridsens
hybridsens.configure()
import jax.numpy as jnp
from hybridsens.sweeps import grid, sweep
axis = np.linspace(0.0, 1.0, 40)
design = grid({"a": jnp.array(1.0), "b": jnp.array(2.0)}, {"a": axis, "b": axis})
swept = lambda store: sweep(lambda s: jnp.sin(s["a"]) * s["b"], design, chunk=40, progress=False, store=store)
found = swept(sys.argv[1])
if "compare" in sys.argv:
    assert found.load().drop_attrs().identical(swept(None).drop_attrs())
"""


def chunks(store):
    """When each chunk of the status was written; one that was killed in the middle of it is left as `*.partial`."""
    written = (path for path in store.glob("status/c/**/*") if path.is_file() and path.suffix != ".partial")
    return {path: path.stat().st_mtime_ns for path in written}


def test_a_sweep_killed_in_the_middle_resumes_with_no_point_lost_or_done_twice(tmp_path):
    """Assert that after kill -9 finished chunks stay untouched and the result is an uninterrupted run's, bit by bit."""
    store = tmp_path / "sweep.zarr"
    process = subprocess.Popen([sys.executable, "-c", SCRIPT, str(store)])
    while len(chunks(store)) < 5:
        assert process.poll() is None, "the sweep ended before it could be killed"
        time.sleep(0.002)
    os.kill(process.pid, signal.SIGKILL)
    process.wait()
    before = chunks(store)
    assert 5 <= len(before) < TILES
    subprocess.run([sys.executable, "-c", SCRIPT, str(store), "compare"], check=True, timeout=120)
    after = chunks(store)
    assert len(after) == TILES and all(after[path] == written for path, written in before.items())


@pytest.fixture
def swept(tmp_path):
    def product(scene):
        return scene["a"] * scene["b"]

    def run(values, where="sweep.zarr", cost=product):
        design = grid(SCENE, {"a": np.asarray(values, float)})
        return sweep(cost, design, chunk=2, store=tmp_path / where, progress=False)

    return run


@pytest.mark.parametrize("stored", [True, False])
def test_an_interrupted_sweep_keeps_what_is_finished_and_a_store_goes_on(stored, tmp_path, monkeypatch):
    """Assert that Ctrl-C in the third of five chunks leaves the first two, and that the same call does the rest."""
    asked = dict(chunk=2, progress=False, store=tmp_path / "sweep.zarr" if stored else None)
    design, square = grid(SCENE, {"a": np.arange(10.0)}), lambda scene: scene["a"] ** 2
    run, chunks_run = Engine.run, []

    def interrupted_in_the_third(engine, block):
        chunks_run.append(block)
        if len(chunks_run) == 3:
            raise KeyboardInterrupt
        return run(engine, block)

    monkeypatch.setattr(Engine, "run", interrupted_in_the_third)
    begun = sweep(square, design, **asked)
    assert "interrupted" in begun.attrs and status_counts(begun) == {"none": 6, "successful": 4}
    np.testing.assert_array_equal(begun.J, [0, 1, 4, 9] + 6 * [np.nan])
    whole = sweep(square, design, **asked)
    assert "interrupted" not in whole.attrs and len(chunks_run) == (3 + 3 if stored else 3 + 5)
    np.testing.assert_array_equal(whole.J, np.arange(10.0) ** 2)


def test_a_chunk_without_its_status_is_computed_again(swept, tmp_path):
    """Assert that a chunk whose other arrays were written before the kill is not taken for a finished one."""
    swept([1, 2, 3, 4])
    (tmp_path / "sweep.zarr/status/c/1").unlink()
    zarr.open_group(tmp_path / "sweep.zarr")["J"][2:] = 7.0
    np.testing.assert_array_equal(swept([1, 2, 3, 4]).J, [2, 4, 6, 8])


def test_of_two_that_begin_together_the_second_goes_on_in_the_store_of_the_first(swept, tmp_path, monkeypatch):
    """The other one makes its store, and finishes a chunk, while this one makes its own: both crashed, for good."""
    create = store._create

    def create_while_another_does(place, *of_the_sweep):
        create(tmp_path / "sweep.zarr", *of_the_sweep)
        group = zarr.open_group(tmp_path / "sweep.zarr")
        for name in ("J", "dJ_da", "dJ_db", "status"):
            group[name][:2] = 0 if name == "status" else 7
        create(place, *of_the_sweep)

    monkeypatch.setattr(store, "_create", create_while_another_does)
    np.testing.assert_array_equal(swept([1, 2, 3, 4]).J, [7, 7, 6, 8])
    assert [path.name for path in tmp_path.iterdir()] == ["sweep.zarr"]


def test_of_two_different_ones_that_begin_together_the_second_is_refused(swept, tmp_path, monkeypatch):
    """It returned the values of the first, without a word."""
    create = store._create

    def create_while_another_does(place, digest, *of_the_sweep):
        create(tmp_path / "sweep.zarr", "another", *of_the_sweep)
        create(place, digest, *of_the_sweep)

    monkeypatch.setattr(store, "_create", create_while_another_does)
    with pytest.raises(ValueError, match="belongs to something else"):
        swept([1, 2])


def test_lost_chunks_are_told_of(swept, tmp_path):
    """They were read as nan, with status 0. Values that are nan are not lost."""
    no_number = lambda scene: jnp.where(scene["a"] < 2.5, jnp.nan, scene["a"])
    swept([1, 2, 3], cost=no_number)
    np.testing.assert_array_equal(swept([1, 2, 3], cost=no_number).J, [np.nan, np.nan, 3.0])
    shutil.rmtree(tmp_path / "sweep.zarr/a/c")
    np.testing.assert_array_equal(swept([1, 2, 3], cost=no_number).a, [1, 2, 3])
    (tmp_path / "sweep.zarr/J/c/1").unlink()
    with pytest.raises(ValueError, match="cannot be read: chunks of J are lost. Remove it"):
        swept([1, 2, 3], cost=no_number)


def test_a_store_killed_while_it_was_made_is_made_again(swept, tmp_path):
    """Assert that a store without all of its arrays, or an empty folder, is no obstacle."""
    (tmp_path / "sweep.zarr").mkdir()
    expected = swept([1, 2]).load()
    group = zarr.open_group(tmp_path / "sweep.zarr")
    mark = dict(group.attrs["hybridsens_sweep"])
    del mark["state"]
    group.attrs["hybridsens_sweep"] = mark
    shutil.rmtree(tmp_path / "sweep.zarr/J")
    xr.testing.assert_equal(swept([1, 2]).load(), expected)


def test_a_store_of_something_else_is_refused(swept, tmp_path):
    """Assert that other points, another cost, or a stranger's folder raise instead of being mixed or overwritten."""
    swept([1, 2])
    with pytest.raises(ValueError, match="must be a new place or the store of this very sweep"):
        swept([1, 3])
    with pytest.raises(ValueError, match="must be a new place"):
        swept([1, 2], cost=lambda scene: scene["a"] + scene["b"])
    (tmp_path / "precious").mkdir()
    (tmp_path / "precious/thesis.tex").touch()
    with pytest.raises(ValueError, match="must be a new place"):
        swept([1, 2], "precious")


@pytest.mark.parametrize(
    ("file", "content"), [("zarr.json", b"xx"), ("zarr.json", b""), ("zarr.json", b"[]"), ("status/c/0", b"xx")]
)
def test_a_destroyed_store_is_named_with_the_way_out(swept, tmp_path, file, content):
    """Assert that a store whose metadata or statuses are no longer readable raises with its path and a remedy."""
    swept([1, 2])
    (tmp_path / "sweep.zarr" / file).write_bytes(content)
    with pytest.raises(ValueError, match="sweep.zarr cannot be read: .* Remove it, and the sweep starts anew"):
        swept([1, 2])


@pytest.mark.parametrize("as_arguments", [False, True])
def test_a_store_knows_the_data_of_its_cost(swept, as_arguments):
    """Assert that a cost with the same text and other data is another cost, also where JAX makes arguments of them."""
    with _constants_as_arguments(as_arguments):
        for number, make in enumerate((_closing_over, _jitted_over, _Weighted)):
            run = lambda shift: swept([1, 2], f"{number}.zarr", make(jnp.arange(100.0) + shift))  # noqa: B023
            np.testing.assert_array_equal(run(1).J, [5050, 10100])
            np.testing.assert_array_equal(run(1).J, [5050, 10100])
            with pytest.raises(ValueError, match="must be a new place or the store of this very sweep"):
                run(2)


def test_a_store_knows_the_integers_of_its_scenes(tmp_path):
    """Scenes that differ in a whole number alone, which is no parameter, are others. One without entries is no loss."""
    run = lambda power: sweep(
        lambda scene: scene["a"] ** scene["power"],
        grid(SCENE | {"power": jnp.array(power), "none": jnp.zeros(0)}, {"a": [1.0, 2.0]}),
        store=tmp_path / "s.zarr", progress=False,
    )  # fmt: skip
    np.testing.assert_array_equal(run(2).J, [1, 4])
    np.testing.assert_array_equal(run(2).J, [1, 4])
    with pytest.raises(ValueError, match="must be a new place or the store of this very sweep"):
        run(3)


def _closing_over(weights):
    return lambda scene: jnp.sum(weights * scene["a"])


def _jitted_over(weights):
    return lambda scene: jnp.sum(jax.jit(lambda a: weights * a)(scene["a"]))


class _Weighted(eqx.Module):
    weights: jax.Array

    def __call__(self, scene):
        return jnp.sum(self.weights * scene["a"])


@contextlib.contextmanager
def _constants_as_arguments(wanted):
    before = jax.config.jax_use_simplified_jaxpr_constants
    jax.config.update("jax_use_simplified_jaxpr_constants", wanted)
    try:
        yield
    finally:
        jax.config.update("jax_use_simplified_jaxpr_constants", before)


def test_units_may_be_given_to_a_store_that_is_there(tmp_path):
    """Assert that a sweep which finds all of its points has the units that it is given: they were left out."""
    swept = lambda **units: sweep(lambda s: s["a"], grid(SCENE, {"a": [1.0, 2.0]}), store=tmp_path / "s.zarr",
                                  progress=False, **units)  # fmt: skip
    swept()
    found = swept(units={"J": "m", "a": "kg"})
    assert [found[name].attrs["units"] for name in ("J", "a", "dJ_da")] == ["m", "kg", "m/kg"]


def test_a_finished_store_opens_with_plain_xarray(tmp_path):
    """Assert that xarray alone sees dimensions, coordinates, values and units."""
    design = random(SCENE, {"a": (0.0, 1.0), "b": (1.0, 2.0)}, 10)
    sweep(lambda s: s["a"] * s["b"], design, chunk=4, store=tmp_path / "s.zarr", units={"a": "kg"}, progress=False)
    read = xr.open_zarr(tmp_path / "s.zarr", chunks=None)
    assert set(read.coords) == {"a", "b"} and read.a.attrs["units"] == "kg"
    np.testing.assert_allclose(read.J, read.a * read.b, rtol=1e-15)
    np.testing.assert_array_equal(read.dJ_da, read.b)
