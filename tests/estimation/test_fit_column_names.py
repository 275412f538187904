"""Which entry of the state a column is, and which is the time: the names that this package writes are read."""

import jax.numpy as jnp
import numpy as np
import pytest

import hybridsens as hs
from hybridsens.cli.fit import _columns
from hybridsens.estimation import read_measurements
from hybridsens.estimation.observers import observer, picks
from hybridsens.scenes import BouncingBall

START = (hs.State([1.0], [0.0]),)
TIMES = np.array([0.1, 0.2, 0.4])


def _motion_of(scene):
    """A fall from 1, in two samples."""
    return hs.simulate(scene, scene.initial_state(), t1=0.2, ts=jnp.array([0.1, 0.2]), max_events=8, max_steps=128)


class Named(BouncingBall):
    coordinates = ("height [m]",)


@pytest.mark.parametrize("scene", [BouncingBall(), Named()], ids=["q[0]", "height [m]"])
def test_the_tables_of_a_motion_are_measurements(scene, tmp_path):
    """Assert that a DataFrame of `to_pandas()`, whose index is the time, and the CSV file made of it are those of q and
    v."""
    pytest.importorskip("pandas")
    table = _motion_of(scene).to_pandas()
    table.to_csv(tmp_path / "motion.csv")
    for source in (table, tmp_path / "motion.csv"):
        record = read_measurements(source)
        np.testing.assert_array_equal(record.times, [0.1, 0.2])
        np.testing.assert_array_equal(record.values, table.to_numpy())
        assert picks(record.names, scene, START) == (0, 1)


@pytest.mark.parametrize("name", ["height", "height [m]", "q", "q0", "q[0]", "q_0", "q0 [m]", "q[0] [m]"])
def test_a_column_may_have_the_name_of_the_scene_and_a_unit(name):
    """Assert that each is the first coordinate, and that its rate is the velocity."""
    for rate in ("height rate", "height rate [m/s]"):
        assert picks([name, rate], Named(), START) == (0, 1)


@pytest.mark.parametrize(
    ("name", "coordinates", "message"),
    [
        ("height [mm]", ("height [m]",), "'height .mm.' must be in the scene's unit, .* 'height .m.', but is in mm"),
        ("q0 [mm]", ("height [m]",), "'q0 .mm.' must be in the scene's unit, .* 'height .m.', but is in mm"),
        ("width", ("height [m]",), r"after the state \(q0, v0; or height \[m\], height rate \[m/s\]\), .* is 'width'"),
        ("v0", ("v0",), "but there is 'v0', which names two entries"),
    ],
)
def test_a_column_of_another_unit_or_of_two_entries_is_refused(name, coordinates, message):
    class Other(BouncingBall):
        pass

    Other.coordinates = coordinates
    with pytest.raises(ValueError, match=message):
        picks([name], Other(), START)


def test_times_in_another_unit_or_in_no_number_are_not_guessed():
    """Assert that milliseconds and dates are no times unless they are said to be; and that an index may be."""
    pandas = pytest.importorskip("pandas")
    for name in ("t [ms]", "Time (ms)"):
        with pytest.raises(ValueError, match="times '.*' must be in seconds, or .* are in 'ms': convert them"):
            read_measurements({name: TIMES, "q0": TIMES})
    with pytest.raises(ValueError, match="\"t\" or \"time\" .s., but has .'hours', 'q0'.*time='name'.*rename it.$"):
        read_measurements({"hours": TIMES, "q0": TIMES})
    table = pandas.DataFrame({"q0": TIMES}, pandas.Index(TIMES, name="hours"))
    np.testing.assert_array_equal(read_measurements(table, time="hours").times, TIMES)
    with pytest.raises(ValueError, match=r"but has \['hours', 'q0'\]\. Say which"):
        read_measurements(table)
    with pytest.raises(ValueError, match=r"If it is the index, name that: `data.rename_axis"):
        read_measurements(table.rename_axis(None))
    table.index = pandas.date_range("2020-01-01", periods=3, name="time")
    with pytest.raises(ValueError, match='`times` must be in seconds, or durations, but are dates'):
        read_measurements(table)


def test_a_key_of_the_state_may_have_a_unit():
    """Assert that a column with it, or without, is the entry, and that one in another unit is refused."""
    start = ({"v [mV]": jnp.array(1.0), "w [A]": jnp.ones(2)},)
    assert picks(["v [mV]", "w [A][1]"], None, start) == (0, 2)
    assert picks(["v"], None, start) == (0,)
    with pytest.raises(ValueError, match=r"must be in the system's unit, which names it 'v \[mV\]', but is in V"):
        picks(["v [V]"], None, start)


@pytest.mark.parametrize("observe", [None, lambda system, t, x: {"height": x["height"]}])
def test_names_that_nobody_wrote_are_told_where_they_come_from(observe):
    """Assert that of (times, values) for a system the message speaks of the state's names, and how to give them."""
    with pytest.raises(ValueError, match=r"height.*Values without names are called q0.*names=\[\.\.\.\]"):
        observer(observe, None, ({"height": jnp.array(1.0)},), hs.measurements(TIMES, TIMES).names)


def test_a_variable_along_another_dimension_is_refused():
    """Of one length with the times it was taken for a column."""
    xarray = pytest.importorskip("xarray")
    dataset = xarray.Dataset({"q0": ("t", 10 * TIMES), "other": ("place", TIMES)}, {"t": TIMES})
    with pytest.raises(ValueError, match="'other' must have one or two dimensions, of which the first is the time 't'"):
        read_measurements(dataset)


def test_complex_numbers_are_no_measurements():
    """Assert that they are refused; their imaginary part would be lost."""
    with pytest.raises(ValueError, match="must be an array of real numbers"):
        hs.measurements(TIMES, np.array([[1.0], [2.0j], [3.0]]), names=["q0"])


def test_a_table_without_a_header_is_told_of(tmp_path):
    """Its first row would be taken for the names."""
    path = tmp_path / "bare.csv"
    path.write_text("0.1,0.95\n0.2,0.80\n")
    with pytest.raises(ValueError, match="The first line of the table must name its columns, but has numbers alone"):
        read_measurements(path)


@pytest.mark.parametrize("cell", ["", "NA", "n/a", "NULL", "nan"])
def test_a_cell_may_say_that_nothing_was_measured(cell, tmp_path):
    """As R, spreadsheets and data bases write it; left out where that is asked for, and else refused by its row."""
    file = tmp_path / "record.csv"
    file.write_text(f"t,q0\n0.1,1.0\n0.2,{cell}\n0.3,2.0\n")
    np.testing.assert_array_equal(read_measurements(file, missing="skip").values[:, 0], [1.0, np.nan, 2.0])
    with pytest.raises(ValueError, match="row.* 1 .*counted from 0"):
        read_measurements(file)


def test_a_unit_may_be_left_off_in_what_is_asked_for():
    """Of the time, of an index and of a column; where two differ by their unit alone, none is meant."""
    pandas = pytest.importorskip("pandas")
    table = {"Zeit [s]": [0.0, 1.0], "angle (rad)": [1.0, 2.0], "x [m]": [3.0, 4.0], "x [mm]": [5.0, 6.0]}
    frame = pandas.DataFrame(table)
    for data in (table, frame, frame.set_index("Zeit [s]")):
        found = read_measurements(data, time="Zeit", columns=["angle", "x [mm]"])
        assert found.times.tolist() == [0.0, 1.0] and found.values.tolist() == [[1.0, 5.0], [2.0, 6.0]]
        assert found.names == ("angle (rad)", "x [mm]")
        with pytest.raises(ValueError, match=r"must have the columns \['x'\]"):
            read_measurements(data, time="Zeit", columns="x")


@pytest.mark.parametrize(("column", "name"), [("Winkel [deg]", "q0 [deg]"), ("Winkel", "q0")])
def test_a_column_with_a_name_of_its_own_is_mapped(column, name):
    """Assert that it keeps its unit, in which a fit reads it, and its sigmas; and that remarks stay out."""
    table = {"Zeit": TIMES, column: TIMES**2, "sigma_Winkel": 0 * TIMES + 0.1, "remark": ["a", "b", ""]}
    found = read_measurements(table, time="Zeit", columns={"q0": "Winkel"})
    assert found.names == (name,) and found.sigmas is not None
    np.testing.assert_array_equal(found.values[:, 0], TIMES**2)


def test_a_terminal_maps_columns_too():
    """Assert that what has its own name needs none."""
    assert _columns("q0 = Weg [m],v0") == {"q0": "Weg [m]", "v0": "v0"}
    assert _columns("q0, v0") == ["q0", "v0"] and _columns("") is None


def test_a_name_without_its_unit_is_known_by_its_letters():
    with pytest.raises(ValueError, match="Did you mean 'Zeit'"):
        read_measurements({"Zeit [s]": TIMES, "q0": TIMES}, time="zeit")


def test_a_missing_cell_is_told_by_the_name_in_the_file():
    """Though the column is mapped to another name."""
    table = {"t": [0.0, 1.0], "Weg [mm]": [1.0, np.nan]}
    with pytest.raises(ValueError, match=r"Column 'Weg \[mm\]' must have a value in every row"):
        read_measurements(table, columns={"q0": "Weg"})
