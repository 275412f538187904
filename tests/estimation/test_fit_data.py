"""Measurements: every source gives the same record, and what is wrong is named."""

import numpy as np
import pytest

from hybridsens.estimation import measurements, read_measurements

TIMES = np.array([0.1, 0.2, 0.4])
VALUES = np.array([[1.0, 2.0], [3.0, 4.0], [5.0, 6.0]])


def _write(tmp_path, text):
    path = tmp_path / "record.csv"
    path.write_text(text)
    return path


def test_every_source_gives_the_same_record(tmp_path):
    """Assert that a CSV file, pandas, xarray and arrays with the same numbers are read alike."""
    pandas, xarray = pytest.importorskip("pandas"), pytest.importorskip("xarray")
    columns = {"t": TIMES, "q0": VALUES[:, 0], "v0": VALUES[:, 1], "sigma_q0": [0.1] * 3, "sigma_v0": [0.2] * 3}
    rows = "\n".join(",".join(str(column[i]) for column in columns.values()) for i in range(3))
    dataset = xarray.Dataset({name: ("t", column) for name, column in columns.items() if name != "t"}, {"t": TIMES})
    sources = [
        _write(tmp_path, f"# a comment\n{','.join(columns)}\n{rows}\n"),
        pandas.DataFrame(columns),
        dataset,
        columns,
    ]
    for source in sources:
        record = read_measurements(source)
        assert record.names == ("q0", "v0")
        np.testing.assert_array_equal(record.times, TIMES)
        np.testing.assert_array_equal(record.values, VALUES)
        np.testing.assert_array_equal(record.sigmas, [[0.1, 0.2]] * 3)


def test_a_data_array_with_two_dimensions_has_numbered_columns():
    """Assert that an xarray DataArray (time, dof) named q becomes the columns q0 and q1."""
    xarray = pytest.importorskip("xarray")
    record = read_measurements(xarray.DataArray(VALUES, dims=("time", "dof"), coords={"time": TIMES}, name="q"))
    assert record.names == ("q0", "q1")
    np.testing.assert_array_equal(record.values, VALUES)


@pytest.mark.parametrize(
    ("times", "message"),
    [
        ([0.1, 0.3, 0.2], "sorted in increasing order, but falls back at row 2"),
        ([0.1, 0.2, 0.2], "free of duplicates, but repeats a time at row 2"),
        ([0.1, np.nan, 0.2], "finite, but is not at row 1"),
    ],
)
def test_bad_times_are_refused(times, message):
    """Assert that unsorted, repeated and missing times are named with their row."""
    with pytest.raises(ValueError, match=message):
        measurements(times, VALUES)


def test_durations_are_seconds_and_dates_are_refused():
    """Assert that no table gives its times in nanoseconds, as NumPy makes numbers of them, or in milliseconds."""
    pandas, xarray = pytest.importorskip("pandas"), pytest.importorskip("xarray")
    lasted, day = pandas.to_timedelta(TIMES, unit="s"), pandas.Timestamp("2020-01-01")
    tables = lambda times: [
        pandas.DataFrame({"time": times, "q0": VALUES[:, 0]}),
        pandas.DataFrame({"q0": VALUES[:, 0]}, pandas.Index(times, name="time")),
        xarray.Dataset({"q0": ("time", VALUES[:, 0])}, {"time": times}),
        (times, VALUES[:, 0]),
    ]
    for table, dated in zip(tables(lasted), tables(day + lasted), strict=True):
        np.testing.assert_allclose(read_measurements(table).times, TIMES, rtol=1e-12)
        with pytest.raises(ValueError, match="`times` must be in seconds, or durations, but are dates: subtract"):
            read_measurements(dated)
    events = measurements(event_times=lasted.to_numpy(), event_sigma=0.1).event_times
    np.testing.assert_allclose(events, TIMES, rtol=1e-12)
    with pytest.raises(ValueError, match="times 'time' must be in seconds, or .* in 'ms': convert"):
        read_measurements(xarray.Dataset({"q0": ("time", VALUES[:, 0])}, {"time": ("time", TIMES, {"units": "ms"})}))


def test_gaps_are_refused_unless_asked_for(tmp_path):
    """Assert that an empty cell is an error that names column and row, and with `missing="skip"` a NaN."""
    path = _write(tmp_path, "t,q0\n0.1,1\n0.2,\n0.3,2\n")
    with pytest.raises(ValueError, match="Column 'q0' must have a value in every row, but is NaN at row 1"):
        read_measurements(path)
    assert np.isnan(read_measurements(path, missing="skip").values[1, 0])


def test_what_could_be_read_in_two_ways():
    """One name is one column; a gap needs no sigma; a vector of sigmas is refused where rows are as many as columns."""
    table = {"t": TIMES, "ab": VALUES[:, 0], "a": VALUES[:, 1], "b": VALUES[:, 1]}
    assert read_measurements(table, columns="ab").names == ("ab",)
    assert read_measurements((TIMES, VALUES[:, 0]), columns="ab").names == ("ab",)
    gap = read_measurements({"t": TIMES, "q0": [1.0, np.nan, 2.0], "sigma_q0": [0.1, np.nan, 0.3]}, missing="skip")
    np.testing.assert_array_equal(gap.sigmas[[0, 2], 0], [0.1, 0.3])
    with pytest.raises(ValueError, match=r"give it the shape \(2, 1\) for one in each row"):
        measurements(TIMES[:2], VALUES[:2], sigma=[0.1, 0.2])


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("Time,q0\n0.1,1\n", "times \"t\" or \"time\" .s., but has .*'Time'.*read_measurements.data, time='Time'."),
        ("s,q0\n0.1,1\n", "times \"t\" or \"time\" .s., but has .*'s', 'q0'.*time='name'"),
        ("t,q0,\n0.1,1,\n", "a name for each column, but has an unnamed column in 't,q0,': .*remove the separator"),
        ("t,q0,,\n0.1,1,,\n", "an unnamed column in 't,q0,,'"),
        ("t,q0\n0.1,1,\n", "row 0 .* must have 2 cells, but has 3, the last one empty"),
        ("t,q0,sigma_v0\n0.1,1,0.1\n", "a column <name> for each sigma_<name>, but has none for .'sigma_v0'."),
        ("t,q0\n0.1,\n", "left out of the fit by `read_measurements.data, missing=.skip..`, in a terminal by --skip"),
    ],
)
def test_a_column_that_cannot_be_meant_is_told_with_what_to_do(text, message, tmp_path):
    """Assert that columns of times by another name, without a name, or of sigmas of nothing are named."""
    path = _write(tmp_path, text)
    with pytest.raises(ValueError, match=message):
        read_measurements(path)


def test_sigmas_of_columns_that_were_not_chosen_are_let_be():
    """Assert that a table may hold more than is fitted."""
    table = {"t": TIMES, "q0": VALUES[:, 0], "sigma_v0": TIMES}
    assert read_measurements(table, columns="q0").sigmas is None
    assert read_measurements(table, columns="sigma_v0").names == ("sigma_v0",)


def test_a_sigma_that_is_none_is_shown_with_its_row():
    """Assert that value and row are named, of values and of event times."""
    with pytest.raises(ValueError, match="`sigma` must be positive .* but is -0.2 at row 1 "):
        measurements([0.1, 0.2], [1.0, 2.0], sigma=[0.1, -0.2])
    with pytest.raises(ValueError, match="`event_sigma` must be positive and finite, but is 0 at rows 0, 1 "):
        measurements(event_times=[0.1, 0.2], event_sigma=0.0)


def test_sigmas_may_be_given_by_name():
    """Each a number or a column, in any order; two rows of two columns are not mistaken for each other."""
    given = {"v0": [0.2, 0.3], "q0": 0.1}
    found = measurements([1.0, 2.0], np.ones((2, 2)), sigma=given, names=["q0", "v0"])
    np.testing.assert_array_equal(found.sigmas, [[0.1, 0.2], [0.1, 0.3]])
    both = measurements([1.0, 2.0], np.ones((2, 2)), sigma={"q0": 0.1, "v0": 0.2}, names=["q0", "v0"])
    np.testing.assert_array_equal(both.sigmas, [[0.1, 0.2]] * 2)
    bare = read_measurements({"t": [1.0], "air [C]": [20.0], "load [C]": [30.0]}, sigma={"air": 2.0, "load [C]": 1.0})
    np.testing.assert_array_equal(bare.sigmas, [[2.0, 1.0]])
    with pytest.raises(ValueError, match="one entry for each observation, q0, v0, but has q0"):
        measurements([1.0, 2.0], np.ones((2, 2)), sigma={"q0": 0.1}, names=["q0", "v0"])


def test_unknown_columns_and_words_are_refused(tmp_path):
    """Assert that a column that is not there, and a cell that is no number, are named."""
    path = _write(tmp_path, "t,q0\n0.1,1\n0.2,two\n")
    with pytest.raises(ValueError, match="row 1 .counted from 0., column 'q0' must be a number, but is 'two'"):
        read_measurements(path)
    with pytest.raises(ValueError, match=r"must have the columns \['force'\], but has \['t', 'q0'\].$"):
        read_measurements({"t": TIMES, "q0": VALUES[:, 0]}, columns=["force"])
    with pytest.raises(ValueError, match="`event_sigma` must be given"):
        measurements(event_times=[1.0, 2.0])
    with pytest.raises(ValueError, match="`event_times` must be finite, but is not at row 1"):
        measurements(event_times=[1.0, np.nan, 2.0], event_sigma=1e-3)
    with pytest.raises(ValueError, match="sorted in increasing order, but falls back at row 2"):
        measurements(event_times=[2.0, np.nan, 1.0], event_sigma=1e-3, missing="skip")


def test_a_part_of_a_record_keeps_the_numbers_of_its_events():
    """Assert rows and events of 0.2 <= t < 0.6, the event before it as not seen; and that an empty part is refused."""
    record = measurements([0.1, 0.2, 0.5, 0.6], [1, 2, 3, 4], sigma=[1, 2, 3, 4],
                          event_times=[0.15, 0.3, 0.7], event_sigma=[1, 2, 3])  # fmt: skip
    part = record.between(0.2, 0.6)
    np.testing.assert_array_equal(part.times, [0.2, 0.5])
    np.testing.assert_array_equal(np.ravel(part.values), [2, 3])
    np.testing.assert_array_equal(np.ravel(part.sigmas), [2, 3])
    np.testing.assert_array_equal(part.event_times, [np.nan, 0.3])
    np.testing.assert_array_equal(part.event_sigmas, [1, 2])
    with pytest.raises(ValueError, match="there is none"):
        record.between(0.8, 0.9)


def test_values_by_name_are_sent_to_the_right_function():
    """Assert that a mapping where an array belongs is refused with the way out."""
    with pytest.raises(ValueError, match="read_measurements"):
        measurements([0.1, 0.2], {"q0": [1.0, 2.0]})


def test_two_columns_of_one_name_are_refused(tmp_path):
    """Assert that a CSV file, a DataFrame and a Dataset in which one column would hide another are refused by name."""
    pandas, xarray = pytest.importorskip("pandas"), pytest.importorskip("xarray")
    path = _write(tmp_path, "t,q0, q0\n0.1,1,2\n")
    with pytest.raises(ValueError, match="record.csv must have columns of different names, but has 2 columns 'q0'"):
        read_measurements(path)
    with pytest.raises(ValueError, match="The table must have columns of different names, but has 2 columns 'q0'"):
        read_measurements(pandas.DataFrame([[0.1, 1.0, 2.0]], columns=["t", "q0", "q0"]))
    numbered = xarray.Dataset({"q": (("t", "dof"), VALUES), "q0": ("t", TIMES)}, {"t": TIMES})
    with pytest.raises(ValueError, match="The Dataset must have columns of different names, but has 2 columns 'q0'"):
        read_measurements(numbered)


@pytest.mark.parametrize("cell", [".", "BLQ", None])
def test_a_column_that_holds_no_numbers_is_named(cell):
    """Text, as a name of a subject or a mark for what was too little to be measured; and an NA among objects."""
    pandas = pytest.importorskip("pandas")
    column = pandas.Series([1.0, pandas.NA if cell is None else cell], dtype=object)
    table = pandas.DataFrame({"time": [1.0, 2.0], "conc": column})
    with pytest.raises(ValueError, match="Column 'conc' must hold numbers, and NaN .* `read_measurements"):
        read_measurements(table, missing="skip")


@pytest.mark.parametrize("sigma", ["sigma_x [mm]", "sigma_x"])
def test_the_unit_of_a_sigma_may_be_left_off(sigma):
    """Everywhere else "x" stands for "x [mm]" too."""
    found = read_measurements({"t": TIMES, "x [mm]": [1.0, 2.0, 3.0], sigma: [0.1, 0.2, 0.3]})
    assert found.names == ("x [mm]",)
    np.testing.assert_array_equal(found.sigmas[:, 0], [0.1, 0.2, 0.3])


def test_what_a_mask_hides_is_missing():
    """The number under the mask was fitted."""
    hidden = np.ma.masked_array(VALUES[:, 0], mask=[False, True, False])
    for data in ((TIMES, hidden), {"t": TIMES, "q0": hidden}):
        with pytest.raises(ValueError, match="is NaN at row 1"):
            read_measurements(data)
        np.testing.assert_array_equal(read_measurements(data, missing="skip").values[:, 0], [1.0, np.nan, 5.0])
    with pytest.raises(ValueError, match="`times` must be finite, but is not at row 1"):
        measurements(np.ma.masked_array(TIMES, mask=hidden.mask), VALUES)
