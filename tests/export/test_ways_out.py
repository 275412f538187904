"""Out of a motion lead tables, data sets, files and other times, and a file leads back."""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest

import hybridsens as hs
from hybridsens.export.datasets import optional
from hybridsens.export.names import Names
from hybridsens.export.text import table
from hybridsens.export.trajectory import events_frame, motion_dataset
from hybridsens.scenes import StackedBalls

TS = jnp.linspace(0, 1, 9)


class NamedBalls(StackedBalls):
    """Two balls whose coordinates and contacts have names."""

    coordinates = ("low [m]", "high")
    contacts = ("floor", "balls")


def _cost(scene, t, q, v):
    return {"squares": q @ q, "both": (q[0], v)}


@pytest.fixture(scope="module")
def motion():
    scene = NamedBalls()
    return hs.simulate(scene, scene.initial_state(), t1=1.0, ts=TS, running_cost=_cost, max_events=8)


def test_samples_and_events_are_tables(motion):
    """Columns have the scene's names, and there are as many events as there were."""
    samples, events = motion.to_pandas(), motion.events.to_pandas()
    assert list(samples.columns) == ["low [m]", "high", "low rate [m/s]", "high rate"]
    np.testing.assert_array_equal(samples.index, TS)
    np.testing.assert_array_equal(samples["high rate"], motion.v[:, 1])
    n = int(motion.events.count)
    assert 0 < len(events) == n < 8
    np.testing.assert_array_equal(events["time [s]"], motion.events.time[:n])
    contact = np.asarray(motion.events.contact[:n])
    np.testing.assert_array_equal(events["impulse [N s]"], motion.events.impulse[np.arange(n), contact])
    assert set(events["kind"]) == {"impact"}
    assert events["contact"].tolist() == [NamedBalls.contacts[i] for i in contact]
    assert "low rate [m/s] before" in events.columns


@pytest.mark.parametrize(
    ("coordinates", "contacts", "known"),
    [
        (None, None, True), (("x [m]", "angle [rad]"), None, True), (("x [m]", "lift [mm]"), None, False),
        (None, ("foot [m]", "wall"), True), (None, ("foot [m]", "stop [rad]"), False),
    ],
)  # fmt: skip
def test_numbers_of_a_contact_have_units_where_these_are_known(motion, coordinates, contacts, known):
    """A scene that counts in millimetres has gaps of which nothing tells the unit; one with a stop in rad has two."""
    scene = Names(coordinates, contacts)
    columns = set(events_frame(motion.events, scene).columns)
    assert ({"closing speed [m/s]", "impulse [N s]"} <= columns, {"closing speed", "impulse"} <= columns) == (
        known, not known,
    )  # fmt: skip
    dataset = motion_dataset(motion, scene)
    assert ["units" in dataset[name].attrs for name in ("impulse", "closing_speed")] == [known, known]


def test_a_print_has_the_names_of_contacts_and_the_numbers_of_parameters(motion):
    """And a gradient, which is a scene too, shows its numbers; a large array its shape."""
    assert {line.split()[3] for line in str(motion).splitlines() if " impact " in line} == {"floor", "balls"}
    assert "mass_low=2.5" in repr(NamedBalls(mass_low=2.5)) and repr(motion.final).startswith("State(q=[")
    assert "f64[30]" in repr(hs.State(jnp.zeros(30), jnp.zeros(30)))
    traced = []
    jax.jit(lambda scene: traced.append(repr(scene)))(NamedBalls())
    assert "f64[]" in traced[0]


def test_a_print_is_not_spoilt_by_a_tiny_number(motion):
    """Each number is written by itself, what is left of a decay is 0, and a cost of any structure shows its numbers."""
    tiny = np.array([0.5, 6.6e-229, -2.5e-17, 12345.678])
    printed = str(eqx.tree_at(lambda m: (m.final.q, m.final.v), motion, (tiny, -tiny))).splitlines()
    assert printed[-1] == "final: q = [0.5 0. -2.5e-17 12345.678], v = [-0.5 0. 2.5e-17 -12345.678]"
    assert "Array" not in next(line for line in printed if line.startswith("cost: "))
    assert repr(hs.State(tiny[:2], np.array([np.nan, 1e9]))) == "State(q=[0.5, 0.], v=[nan, 1.e+09])"


def test_a_status_is_printed_with_its_name(motion):
    """By which the reference lists it; a batch by how many have each, a motion with the time at which it broke off."""
    short = hs.Status.max_events_reached
    assert str(short) == f"max_events_reached: {hs.Status[short]}" and "more events than" in hs.Status[short]
    broken_off = eqx.tree_at(lambda m: m.status, motion, short)
    assert str(broken_off).splitlines()[0] == f"status: {short} It broke off at t = 1."
    assert repr(hs.Status.successful) == "Status<successful>"
    batch = jax.tree.map(lambda *leaves: jnp.stack(leaves), short, hs.Status.successful, hs.Status.successful)
    assert str(batch) == "2 successful, 1 max_events_reached"
    traced = []
    jax.jit(lambda status: traced.append(str(status)))(short)
    assert traced == ["traced"]


def test_a_data_set_holds_all_of_a_motion(motion):
    """By name: samples, events without padding, and each part of the cost."""
    dataset = motion.to_xarray()
    np.testing.assert_array_equal(dataset.q.sel(coordinate="high"), motion.q[:, 1])
    balls = motion.events.impulse[: int(motion.events.count), 1]
    np.testing.assert_array_equal(dataset.impulse.sel(contact="balls"), balls)
    assert dataset["cost.both.1"].values.tolist() == motion.cost["both"][1].tolist()
    assert dataset.status == "successful"


@pytest.mark.parametrize("sampled", [True, False])
def test_a_file_gives_the_motion_back(motion, sampled, tmp_path):
    """Every number and every type, in the same structure, but for the padding behind the events."""
    if not sampled:
        motion = eqx.tree_at(lambda m: (m.ts, m.q, m.v), motion, (None, None, None))
    motion.save(tmp_path / "motion.nc")
    loaded = hs.load(tmp_path / "motion.nc")
    n = int(motion.events.count)
    cut = lambda m: eqx.tree_at(
        lambda m: m.events, m, jax.tree.map(lambda leaf: leaf[:n] if leaf.ndim else leaf, m.events)
    )
    found, known = (jax.tree.leaves_with_path(cut(m)) for m in (loaded, motion))
    assert [path for path, _ in found] == [path for path, _ in known]
    for (path, leaf), (_, expected) in zip(found, known, strict=True):
        np.testing.assert_array_equal(leaf, expected, err_msg=str(path))
        assert leaf.dtype == expected.dtype, path
    assert loaded.events.time.shape == (8,) and bool(jnp.all(jnp.isinf(loaded.events.time[n:])))


def test_a_motion_from_a_file_has_its_names(motion, tmp_path):
    """Its print, its tables and its data set are those of the motion that was saved."""
    motion.save(tmp_path / "motion.nc")
    loaded = hs.load(tmp_path / "motion.nc")
    assert str(loaded) == str(motion)
    assert loaded.to_pandas().equals(motion.to_pandas())
    assert loaded.events.to_pandas().equals(motion.events.to_pandas())
    assert loaded.to_xarray().identical(motion.to_xarray())
    with pytest.raises(ValueError, match="must know the scene of its motion, which is lost where a motion is loaded"):
        loaded.evaluate(0.5)


def test_a_motion_from_a_file_has_no_names_that_it_did_not_have(motion, tmp_path):
    """One that does not know its scene has numbers, before and after."""
    nameless = jax.tree.map(lambda leaf: leaf, motion)
    nameless.save(tmp_path / "motion.nc")
    loaded = hs.load(tmp_path / "motion.nc")
    assert list(loaded.to_pandas().columns) == ["q[0]", "q[1]", "v[0]", "v[1]"]
    assert str(loaded) == str(nameless)


def test_a_file_of_another_kind_is_not_written(motion, tmp_path):
    """A table, say; a name without an ending is that of a netCDF file."""
    with pytest.raises(ValueError, match=r"must end in .nc, .* but is a.csv: .*to_pandas\(\)\.to_csv"):
        motion.save(tmp_path / "a.csv")
    motion.save(tmp_path / "a")
    assert [path.name for path in tmp_path.iterdir()] == ["a"]


def test_a_file_stays_whole_where_a_new_one_cannot_be_written(motion, tmp_path, monkeypatch):
    """Assert that a save which breaks off (a disk that is full) leaves the file that was there, and nothing else."""
    xarray = pytest.importorskip("xarray")
    path = tmp_path / "motion.nc"
    motion.save(path)
    before = path.read_bytes()

    def half(dataset, path, **_):
        path.write_bytes(before[: len(before) // 2])
        raise RuntimeError("NetCDF: HDF error")

    monkeypatch.setattr(xarray.Dataset, "to_netcdf", half)
    with pytest.raises(RuntimeError, match="HDF error"):
        motion.save(path)
    assert path.read_bytes() == before and list(tmp_path.iterdir()) == [path]


def test_a_place_that_is_none_is_named(motion, tmp_path):
    """Assert that a folder, and a file in none, are refused in words: netCDF4 speaks of permissions."""
    for path, what in ((tmp_path, "is a folder"), (tmp_path / "none" / "a.nc", "in a folder that does not exist")):
        with pytest.raises(ValueError, match=f"must be that of a file in a folder that exists, but .*{what}"):
            motion.save(path)


def test_a_file_of_another_origin_is_refused(motion, tmp_path):
    """Only `save` writes what `load` reads."""
    motion.to_xarray().to_netcdf(tmp_path / "other.nc")
    (tmp_path / "text.nc").write_text("time,q[0]")
    for name in ("other.nc", "text.nc"):
        with pytest.raises(ValueError, match="must be a file that `save`"):
            hs.load(tmp_path / name)
    with pytest.raises(FileNotFoundError):
        hs.load(tmp_path / "none.nc")


@pytest.mark.slow
def test_other_times_are_as_exact_as_the_motion(motion):
    """In any order and shape; the free flight of both balls has a closed form."""
    early = np.array([[0.3, 0.0], [0.1, 0.2]])
    found = motion.evaluate(early)
    np.testing.assert_allclose(found.q[..., 0], 1 - 9.81 * early**2 / 2, rtol=1e-13)
    np.testing.assert_allclose(motion.evaluate(0.2).v, found.v[1, 1], rtol=1e-13)
    np.testing.assert_array_equal(motion.evaluate(TS[5]).q, motion.q[5])
    with pytest.raises(ValueError, match=r"lie within \[t0, t1\] = \[0, 1\], but 1.5 does not"):
        motion.evaluate(1.5)
    with pytest.raises(ValueError, match="evaluate.. must be given known times"):
        jax.grad(lambda t: motion.evaluate(t).q[0])(0.5)


def test_a_motion_that_lost_its_scene_says_so(motion):
    """One that JAX made anew has its numbers and no more."""
    with pytest.raises(ValueError, match="Pass `ts=`"):
        jax.tree.map(lambda leaf: leaf, motion).evaluate(0.5)


def test_names_must_be_as_many_as_there_are():
    """One name for two coordinates is an error, and two for one."""
    from hybridsens.export.names import coordinate_names

    class Misnamed(StackedBalls):
        coordinates = ("low [m]",)

    with pytest.raises(ValueError, match="tuple of 2 names, one for each entry"):
        coordinate_names(Misnamed(), 2)
    Misnamed.coordinates = ("low [m]", "high [m]")
    with pytest.raises(ValueError, match=r"tuple of 1 name, one for each entry of q \(the state has 1\)"):
        coordinate_names(Misnamed(), 1)


def test_a_library_that_is_missing_is_named_with_its_extra():
    """So that one knows what to install."""
    with pytest.raises(ImportError, match=r"to_nowhere\(\) needs .*pip install 'hybridsens\[tables\]'"):
        optional("no_such_library_at_all", "to_nowhere()")


def test_a_notebook_shows_events_as_a_table(motion):
    """One row for each event, and text that could be HTML is not taken for it."""
    page = motion._repr_html_()
    assert page.count("<tr>") == 1 + int(motion.events.count)
    assert "status: successful" in page
    assert "&lt;b&gt;" in table(["<b>"], []) and "<b>" not in table(["head"], [["<b>"]])


@pytest.mark.parametrize("names", [("x", "x"), ("x [m]", "x rate [m/s]"), ("kind", "y")])
def test_coordinates_that_share_a_name_are_refused(names, motion):
    """A table would keep one of them only."""
    with pytest.raises(ValueError, match="must have different names, but .* is that of more than one: rename it"):
        events_frame(motion.events, Names(names, None))
