"""Batches of motions: parts of them, tables and data sets of all, files."""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest

import hybridsens as hs
from hybridsens.scenes import StackedBalls

TS = jnp.linspace(0, 0.5, 5)
MOST = 8


class Filling(hs.AbstractHybridSystem):
    """A tank that is emptied when it is full, which its mode counts."""

    rate: jax.Array
    event_names = ("full",)

    def flow(self, t, x, mode):
        return {"level": self.rate}

    def guards(self, t, x, mode):
        return 1.0 - x["level"][None]

    def transition(self, event, t, x, mode):
        return {"level": jnp.zeros_like(x["level"])}, {"emptied": mode["emptied"] + 1}


def _balls(t1, ts):
    scene = StackedBalls()
    work = lambda scene, t, q, v: {"squares": q @ q, "fast": v}
    return hs.simulate(scene, scene.initial_state(), t1=t1, ts=ts, running_cost=work, max_events=MOST)


def _tank(t1, ts):
    start = {"level": jnp.zeros(())}
    return hs.solve(Filling(jnp.array(3.5)), start, {"emptied": jnp.array(0)}, t1=t1, ts=ts, max_events=MOST)


ENDS = jnp.array([0.455, 1.0, 0.7])
"""Of the three motions, which have one event, three and two."""


@pytest.fixture(scope="module", params=[_balls, _tank])
def batch(request):
    return jax.jit(jax.vmap(lambda t1: request.param(t1, t1 / 0.5 * TS)))(ENDS)


def _same(found, known):
    """Whether every number and every type is."""
    for (path, leaf), (_, expected) in zip(*map(jax.tree.leaves_with_path, (found, known)), strict=True):
        np.testing.assert_array_equal(leaf, expected, err_msg=str(path))
        assert leaf.dtype == expected.dtype, path


def test_a_part_of_a_batch_is_taken_by_its_index(batch):
    """As of an array, but that a place outside of the batch is refused, where JAX would take the last motion."""
    counts = batch.events.count.tolist()
    assert len(set(counts)) == 3 and max(counts) < MOST, "each has another number of events"
    assert [int(one.events.count) for one in batch] == counts == [int(batch[i].events.count) for i in (0, 1, -1)]
    assert float(batch[1].end_time) == 1.0 and str(batch[1]).startswith("status: successful")
    long = batch[batch.end_time > 0.6]
    assert long.end_time.tolist() == batch[1:].end_time.tolist() == batch[[1, 2]].end_time.tolist() == [1.0, 0.7]
    _same(batch[..., 1], batch[1])
    twice = jax.tree.map(lambda leaf: jnp.stack([leaf, leaf]), batch)
    assert eqx.tree_at(lambda b: b.final, batch, jnp.zeros((3, 0)))[1].final.shape == (0,), "a leaf of no numbers"
    traced = jax.jit(lambda twice, i: twice[..., i])(twice, 1)
    for column in (twice[..., 1], twice[:, 1], twice[[0, 1], [1, 1]], traced):
        _same(column[0], batch[1])
    assert jax.jit(lambda batch, i: batch[i].end_time)(batch, 2) == 0.7
    with pytest.raises(IndexError, match="out of bounds"):
        batch[3]
    with pytest.raises(TypeError, match="index must be that of a batch of motions, but this .* is one"):
        batch[0][0]


def test_a_batch_that_is_told_its_scene_has_its_names():
    """JAX made it anew; its parts have the names too, as has what a file gives back."""

    class Named(StackedBalls):
        coordinates = ("low [m]", "high [m]")

    one = Named().initial_state
    simulated = lambda t1: hs.simulate(Named(), one(), t1=t1, ts=TS[:2] * t1, max_events=MOST)
    batch = jax.vmap(simulated)(ENDS)
    assert "q[0]" in batch.to_pandas()
    batch.come_from(Named())
    for told in (batch, batch[1], batch[:2]):
        assert "low [m]" in told.to_pandas() and "high rate [m/s] after" in told.events.to_pandas()
    assert batch.to_xarray().coordinate.values.tolist() == list(Named.coordinates)


def test_a_data_set_of_a_batch_holds_that_of_each_run(batch):
    """In rows for the most events of a run, the others with times inf behind their own."""
    dataset, most = batch.to_xarray(), int(batch.events.count.max())
    assert dataset.sizes["run"] == 3 and dataset.sizes["event"] == most
    for run, one in enumerate(batch):
        alone, count = one.to_xarray(), int(one.events.count)
        of_run = dataset.isel(run=run, event=slice(0, count))
        for name in alone.variables:
            np.testing.assert_array_equal(of_run[name], alone[name], err_msg=name)
        assert np.isinf(dataset.event_time.isel(run=run, event=slice(count, most))).all()
    assert dataset.q.dims[:2] == ("run", "sample") if "q" in dataset else dataset["x.level"].dims == ("run", "sample")


def test_runs_with_the_same_times_share_them(batch):
    """They are the coordinate of the samples, by which a sample is found."""
    at_once = eqx.tree_at(lambda b: b.ts, batch, jnp.broadcast_to(TS, (3, 5)))
    dataset = at_once.to_xarray()
    assert dataset.time.dims == ("time",) and dataset.sel(time=0.25).sizes["run"] == 3


def test_a_file_gives_a_batch_back(batch, tmp_path):
    """Every number and every type, with or without samples, of the same times or not; and its data set."""
    samples = (lambda b: (b.ts, b.x)) if hasattr(batch, "x") else (lambda b: (b.ts, b.q, b.v))
    bare = eqx.tree_at(samples, batch, replace_fn=lambda _: None)
    at_once = eqx.tree_at(lambda b: b.ts, batch, jnp.broadcast_to(TS, (3, 5)))
    for known in (batch, bare, at_once):
        known.save(tmp_path / "batch.nc")
        loaded = hs.load(tmp_path / "batch.nc")
        _same(loaded, eqx.tree_at(lambda b: b.again, known, None) if hasattr(batch, "again") else known)
        assert loaded.to_xarray().identical(known.to_xarray())


def test_tables_of_a_batch_are_those_of_its_runs(batch):
    """Below each other, samples and events; also where a run had no event, and of that run alone."""
    batch = eqx.tree_at(lambda b: b.events.count, batch, batch.events.count.at[0].set(0))
    samples, events = batch.to_pandas(), batch.events.to_pandas()
    assert samples.index.names[0] == "run" and events.index.names == ["run", "event"]
    assert events.index.tolist() == [(run, i) for run in (1, 2) for i in range(int(batch[run].events.count))]
    for run in (1, 2):
        assert samples.loc[run].equals(batch[run].to_pandas())
        assert events.loc[run].equals(batch[run].events.to_pandas())
    assert batch[:1].events.to_pandas().shape == (0, events.shape[1])


def test_a_batch_of_batches_is_taken_apart_first(batch):
    """Asked of more than one axis, of no motion, or of numbers that are not known yet, the message says what to do."""
    for wrong, shape in ((jax.tree.map(lambda leaf: leaf[None], batch), r"\(1, 3\)"), (batch[:0], r"\(0,\)")):
        for way in (wrong.to_xarray, wrong.to_pandas, wrong.events.to_pandas, lambda: wrong.save("none.nc")):  # noqa: B023
            with pytest.raises(ValueError, match=rf"along one axis, but this is a batch of {shape}"):
                way()
    with pytest.raises(ValueError, match="to_pandas.. must be called outside of jax.jit"):
        jax.jit(lambda events: events.to_pandas().shape[0])(batch.events)
