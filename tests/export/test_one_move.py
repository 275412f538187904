"""A file is that of one writer, whole, whoever else writes it or breaks off."""

import pytest

from hybridsens.export.one_move import in_one_move


def test_two_that_write_one_file_at_a_time_do_not_meet(tmp_path):
    """They shared one draft, and the second found it gone."""
    path = tmp_path / "points.csv"
    with in_one_move(path) as late:
        late.write_text("late")
        with in_one_move(path) as early:
            early.write_text("early")
        assert path.read_text() == "early"
    assert path.read_text() == "late" and list(tmp_path.iterdir()) == [path]


def test_one_that_breaks_off_leaves_the_file_as_it_was(tmp_path):
    path = tmp_path / "points.csv"
    path.write_text("whole")
    with pytest.raises(RuntimeError), in_one_move(path) as draft:
        draft.write_text("ha")
        raise RuntimeError
    assert path.read_text() == "whole" and list(tmp_path.iterdir()) == [path]
