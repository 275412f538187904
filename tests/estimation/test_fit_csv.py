"""CSV files: which are read, and what is said of others."""

import numpy as np
import pytest

from hybridsens.estimation import read_measurements


def _write(tmp_path, text):
    path = tmp_path / "record.csv"
    path.write_text(text)
    return path


@pytest.mark.parametrize(
    ("content", "message"),
    [
        ("t,q0,größe\n0.1,1,2\n".encode("latin-1"), "record.csv must be a text file in UTF-8, .* LATIN1.*iconv"),
        ("t,q0\n0.1,1\n".encode("utf-16"), "record.csv must be a text file in UTF-8, .* iconv -f UTF-16"),
        ("t,q0\n0.1,1\n".encode("utf-16-le"), "record.csv must be a text file in UTF-8, but has zero bytes"),
        (b"t q0\n0.1 1\n", "semicolons or tabs between its columns, but has spaces: 't q0'. Replace"),
        (b"t;q0\n0.1;1,000\n", "with points or numbers with commas, but has '0.1' and '1,000'"),
        (b"t\tq0\n0\t1,234\n1\t-1,100\n2\t998\n", "may be decimal ones or part thousands, as in '1,234'"),
    ],
)
def test_a_file_in_another_format_is_named_with_the_way_out(tmp_path, content, message):
    """Assert that another encoding and another separator are errors that name the file and what to do."""
    path = tmp_path / "record.csv"
    path.write_bytes(content)
    with pytest.raises(ValueError, match=message) as refused:
        read_measurements(path)
    assert not isinstance(refused.value, UnicodeDecodeError)


@pytest.mark.parametrize("text", [
    "t;q0\n0,1;-1,5e-3\n0,25;\n", "t\tq0\n0.1\t-1.5e-3\n0.25\tNA\n",
    "t|q0\n.1|-.0015\n.25|\n",
    "sep=;\nt;q0\n0,100;-,0015\n0,250;\n",
])  # fmt: skip
def test_columns_may_be_parted_by_other_marks(tmp_path, text):
    """Assert that semicolons, tabs and bars are read, with decimal commas where commas part no columns."""
    found = read_measurements(_write(tmp_path, text), missing="skip")
    assert found.times.tolist() == [0.1, 0.25] and found.values[0, 0] == -0.0015 and np.isnan(found.values[1, 0])


def test_a_folder_is_no_record(tmp_path):
    """Assert that a folder given as data is an error that says so, as is a file that is not there, or has no rows."""
    with pytest.raises(ValueError, match="must be the path of a CSV file, but .* is a folder"):
        read_measurements(tmp_path)
    with pytest.raises(FileNotFoundError, match="the path of a CSV file, but there is no file .*none.csv"):
        read_measurements(tmp_path / "none.csv")
    with pytest.raises(ValueError, match="a header and at least one row, but has 1 line.$"):
        read_measurements(_write(tmp_path, "t,q0\n"))


def test_columns_that_are_not_used_may_hold_anything(tmp_path):
    """Remarks and dates beside decimal commas; asked for, they are refused with the way to leave them out."""
    path = _write(tmp_path, "t;q0;remark;date\n0,1;1,5;ok. So far;30.11.2026\n0,2;2,5;;30.11.2026\n")
    assert read_measurements(path, columns="q0").values.tolist() == [[1.5], [2.5]]
    assert read_measurements(path, columns={"q1": "q0"}).names == ("q1",)
    with pytest.raises(ValueError, match=r"'remark' must be a number, but is 'ok. So far'.* in a terminal --columns"):
        read_measurements(path)
    with pytest.raises(ValueError, match="column 'date' must be a number, but is '30.11.2026'"):
        read_measurements(path, columns=["q0", "date"])
