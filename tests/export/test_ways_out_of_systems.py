"""Out of a motion of a hybrid system lead tables, data sets and files, and a file leads back."""

import dataclasses
import pickle
import re
import types

import equinox as eqx
import jax
import jax.numpy as jnp
import netCDF4
import numpy as np
import pytest

import hybridsens as hs
from hybridsens.export.names import event_names
from hybridsens.export.trees import as_text

TS = jnp.linspace(0.0, 3.0, 7)


class Dripping(hs.AbstractHybridSystem):
    """Two tanks fill at constant rates; a full one is emptied. Tank k is full at every 1 / rate[k]."""

    rates: jax.Array

    def flow(self, t, x, mode):
        return {"level": self.rates, "clock": (jnp.ones_like(t), 0 * x["clock"][1])}

    def guards(self, t, x, mode):
        return 1.0 - x["level"]

    def transition(self, event, t, x, mode):
        emptied = jnp.arange(2) == event
        return x | {"level": jnp.where(emptied, 0.0, x["level"])}, {"last": event, "count": mode["count"] + emptied}


def _cost(system, t, x, mode):
    return {"water": jnp.sum(x["level"]), "both": (x["level"], x["clock"][0])}


START = {"level": jnp.zeros(2), "clock": (0.0, 7.0)}
MODE = {"last": jnp.array(-1), "count": jnp.zeros(2, int)}


@pytest.fixture(scope="module")
def motion():
    system = Dripping(jnp.array([0.8, 0.45]))
    return hs.solve(system, START, MODE, t1=3.0, ts=TS, running_cost=_cost, max_events=8)


def test_samples_and_events_are_tables(motion):
    """Columns are named by the leaves of the state; rows are the events that there were, at their known times."""
    samples, events = motion.to_pandas(), motion.events.to_pandas()
    modes = ["mode.count[0]", "mode.count[1]", "mode.last"]
    assert list(samples.columns) == ["clock.0", "clock.1", "level[0]", "level[1]", *modes]
    before = np.searchsorted([1 / 0.8, 1 / 0.45, 2 / 0.8], TS, side="right")
    assert samples["mode.count[0]"].tolist() == np.array([0, 1, 1, 2])[before].tolist()
    np.testing.assert_allclose(samples["clock.0"], TS, atol=1e-12)
    np.testing.assert_array_equal(samples["level[1]"], motion.x["level"][:, 1])
    np.testing.assert_allclose(events["time"], [1 / 0.8, 1 / 0.45, 2 / 0.8], rtol=1e-9)
    assert events["guard"].tolist() == events["mode.last after"].tolist() == [0, 1, 0]
    assert events["mode.count[0] after"].tolist() == [1, 1, 2]
    np.testing.assert_allclose(events["level[1] before"], [0.45 / 0.8, 1.0, 0.45 * 2.5 - 1], rtol=1e-7)


def test_a_print_shows_six_digits_of_single_numbers_too(motion):
    """As of arrays: the clock is at 3 but for rounding, and a third has no more digits than others."""
    clocks = eqx.tree_at(lambda m: m.final["clock"], motion, (jnp.array(2.9999999999999), jnp.array(1 / 3)))
    assert str(clocks).splitlines()[-1].startswith("final: {'clock': (3., 0.333333), 'level': [")


def test_a_data_set_holds_all_of_a_motion(motion):
    """By name: samples, events without padding, modes, and each part of the cost; the state has the same dimension
    before and after an event."""
    dataset = motion.to_xarray()
    np.testing.assert_array_equal(dataset["x.level"].sel(time=1.5), motion.x["level"][3])
    assert dataset["event_before.level"].dims == dataset["event_after.level"].dims == ("event", "x.level.axis0")
    assert dataset["event_after.level"].values[0, 0] == 0 and dataset["mode.count"].values.tolist() == [2, 1]
    assert dataset["cost.both.0"].values.tolist() == motion.cost["both"][0].tolist()
    assert dataset.status == "successful"


@pytest.mark.parametrize("sampled", [True, False])
def test_a_file_gives_the_motion_back(motion, sampled, tmp_path):
    """Every number and every type, in the same structure."""
    if not sampled:
        motion = eqx.tree_at(lambda m: (m.ts, m.x), motion, (None, None))
    motion.save(tmp_path / "motion.nc")
    loaded = hs.load(tmp_path / "motion.nc")
    known = eqx.tree_at(lambda m: m.again, motion, None)
    assert jax.tree.structure(loaded) == jax.tree.structure(known)
    found, wanted = (jax.tree.leaves_with_path(m) for m in (loaded, known))
    for (path, leaf), (_, expected) in zip(found, wanted, strict=True):
        np.testing.assert_array_equal(leaf, expected, err_msg=str(path))
        assert leaf.dtype == expected.dtype, path
    with pytest.raises(ValueError, match="must know the system"):
        loaded.evaluate(1.0)


def test_a_file_names_how_the_motion_ended(motion, tmp_path):
    """By which a version that numbers statuses otherwise reads it, or says that it cannot."""
    doubtful = eqx.tree_at(lambda m: m.status, motion, hs.Status.grazing)
    assert doubtful.to_xarray().status == "grazing"
    path = tmp_path / "motion.nc"
    doubtful.save(path)
    assert hs.load(path).status == hs.Status.grazing
    with netCDF4.Dataset(path, "a") as file:
        file["status"][...] = "dazzled"
    with pytest.raises(ValueError, match="of another version of hybridsens, which has a status 'dazzled'"):
        hs.load(path)


def test_a_file_of_another_kind_is_not_written(motion, tmp_path):
    """A table, say; a name without an ending is that of a netCDF file."""
    with pytest.raises(ValueError, match=r"must end in .nc, .* but is a.csv: .*to_pandas\(\)\.to_csv"):
        motion.save(tmp_path / "a.csv")
    motion.save(tmp_path / "a")
    assert [path.name for path in tmp_path.iterdir()] == ["a"]


def test_what_a_file_cannot_hold_is_named(motion, tmp_path):
    """A mode of one's own type."""
    own = eqx.tree_at(lambda m: m.mode, motion, {"place": hs.State(jnp.zeros(2), jnp.zeros(2))})
    with pytest.raises(TypeError, match="`mode.place` can be saved if .* State. Save what `to_xarray"):
        own.save(tmp_path / "motion.nc")
    for key in ("v [m/s]", " v"):
        named = eqx.tree_at(lambda m: m.mode, motion, {key: jnp.zeros(2)})
        with pytest.raises(ValueError, match=f"keys have no slash, .* has {re.escape(repr(key))}: rename"):
            named.save(tmp_path / "motion.nc")
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize("initial", [jnp.array([5.0, 6.0]), 5.0, jnp.ones((2, 3))], ids=jnp.shape)
def test_a_leaf_may_have_the_name_of_another_with_a_number(initial, tmp_path):
    """As that of an initial value does; a file lost it to the dimension of the other one."""

    class Decay(hs.AbstractHybridSystem):
        def flow(self, t, x, mode):
            return jax.tree.map(jnp.negative, x)

        def guards(self, t, x, mode):
            return jnp.zeros(0)

        def transition(self, event, t, x, mode):
            return x, mode

    solved = hs.solve(Decay(), {"v": jnp.ones(2), "v_0": initial}, t1=1.0, ts=TS[:2])
    solved.save(tmp_path / "motion.nc")
    loaded = hs.load(tmp_path / "motion.nc")
    for name, leaf in solved.x.items():
        np.testing.assert_array_equal(loaded.x[name], leaf)


def test_a_queue_of_delays_is_kept_and_printed_in_words(motion, tmp_path):
    """It is a part of the mode that the package itself offers."""
    queue = hs.DelayQueue(jnp.array([True, False, True]), jnp.array(False))
    delayed = eqx.tree_at(lambda m: m.mode, motion, {"queue": queue, "on": jnp.array(True)})
    assert as_text(delayed.mode) == "{'on': True, 'queue': 2 of 3 wait}"
    rows = jax.tree.map(lambda leaf: jnp.stack([leaf] * 8), delayed.mode)
    delayed = eqx.tree_at(lambda m: m.events.mode, delayed, rows)
    table = delayed.events.to_pandas()
    assert table["mode.queue after"].tolist() == [2] * len(table)
    assert not any("taken" in column for column in table)
    delayed.save(tmp_path / "motion.nc")
    loaded = hs.load(tmp_path / "motion.nc")
    assert isinstance(loaded.mode["queue"], hs.DelayQueue)
    for found, known in zip(*map(jax.tree.leaves, (loaded.mode, delayed.mode)), strict=True):
        np.testing.assert_array_equal(found, known)
        assert found.dtype == known.dtype


def test_a_motion_without_samples_has_no_table_of_them(motion):
    """The message names what to pass."""
    with pytest.raises(ValueError, match="pass `ts=` to `solve`"):
        eqx.tree_at(lambda m: (m.ts, m.x), motion, (None, None)).to_pandas()


class Named(Dripping):
    event_names = ("left", "right")


@pytest.fixture(scope="module")
def named():
    return hs.solve(Named(jnp.array([0.8, 0.45])), START, MODE, t1=3.0, ts=TS, max_events=8)


def test_events_have_their_names_in_tables_and_files(named, tmp_path):
    """In one that is loaded, and in pictures, too; a row beyond the last event has none."""
    assert named.events.name(int(named.events.guard[-1])) == ""
    rows = [line.split() for line in str(named).splitlines() if line.split()[0].isdecimal()]
    assert [row[2] for row in rows] == named.events.to_pandas()["name"].tolist() == ["left", "right", "left"]
    assert named.to_xarray()["event_name"].values.tolist() == ["left", "right", "left"]
    named.save(tmp_path / "named.nc")
    assert hs.load(tmp_path / "named.nc").events.names == Named.event_names
    labels = [label.get_text() for axes in hs.plot_solution(named).axes for label in axes.get_yticklabels()]
    assert {"left", "right"} <= set(labels)


def test_one_name_stays_one_in_a_file(named, tmp_path):
    """A netCDF file keeps a list of one text as that text."""
    alone = eqx.tree_at(lambda s: s.events, named, dataclasses.replace(named.events, names=("left",)))
    alone = eqx.tree_at(lambda s: (s.events.guard, s.events.count), alone, (0 * named.events.guard, jnp.array(1)))
    alone.save(tmp_path / "alone.nc")
    assert hs.load(tmp_path / "alone.nc").events.names == ("left",)


def test_guards_may_have_names_alone():
    """Where a schedule has any length. Names for all, or for none, are as they were."""
    names = lambda *given, scheduled=2: event_names(types.SimpleNamespace(event_names=given or None), 2, scheduled, 1)
    assert names("burner", "pump") == ("burner", "pump", "time 0", "time 1", "comparison 0")
    assert names("burner", "pump", "on", "off") == ("burner", "pump", "on", "off", "comparison 0")
    assert names("burner", "pump", scheduled=0) == ("burner", "pump", "comparison 0")
    assert names() == ("0", "1", "2", "3", "comparison 0")
    with pytest.raises(ValueError, match="each guard and then each scheduled time, or one for each guard alone"):
        names("burner", "pump", "on")


def test_events_must_have_a_name_each():
    class Misnamed(Dripping):
        event_names = ("left",)

    with pytest.raises(ValueError, match="`event_names` of Misnamed must be a tuple of 2 names, one for each guard"):
        hs.solve(Misnamed(jnp.ones(2)), START, MODE, t1=1.0)


@pytest.mark.parametrize("state", [{"a": {"b": 1.0}, "a.b": 2.0}, {"v": jnp.ones(1), "v[0]": 2.0}])
def test_entries_of_a_state_that_share_a_name_are_refused(state):
    """A table would keep one of them only."""

    class Still(hs.AbstractHybridSystem):
        def flow(self, t, x, mode):
            return jax.tree.map(jnp.zeros_like, x)

        def guards(self, t, x, mode):
            return jnp.zeros(0)

        def transition(self, event, t, x, mode):
            return x, mode

    motion = hs.solve(Still(), state, t1=1.0, ts=TS[:2])
    with pytest.raises(ValueError, match="must have different names, but .* is that of more than one: rename it"):
        motion.to_pandas()


def test_a_motion_that_was_pickled_is_evaluated(motion):
    """Its system comes along."""
    again = pickle.loads(pickle.dumps(motion))
    np.testing.assert_array_equal(again.x["level"], motion.x["level"])
    np.testing.assert_allclose(again.evaluate([0.3])["level"], [[0.24, 0.135]], atol=1e-9)
