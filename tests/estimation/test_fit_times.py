"""Times of a record: their unit, their order, and where they lie beside the horizon."""

import numpy as np
import pandas
import pytest

from hybridsens.estimation import fit, measurements, read_measurements
from hybridsens.scenes import BouncingBall

MINUTES = np.linspace(0.0, 0.01, 5)


@pytest.mark.parametrize("name", ["time [min]", "time (min)", "t[min]"])
def test_times_in_another_unit_are_refused(name):
    """A fit took minutes for seconds, and found a weight 3600 times too large, with a perfect residual spread."""
    table = pandas.DataFrame({name: MINUTES, "q0": 1 - MINUTES})
    with pytest.raises(ValueError, match=r"in seconds, or in what the model itself counts in.* in 'min': .*\"t\""):
        read_measurements(table, time=name)
    assert read_measurements(table.rename(columns={name: "t"})).times.tolist() == MINUTES.tolist()


@pytest.mark.parametrize("name", ["time [s]", "clock", "time [seconds]", "t[s]"])
def test_times_in_seconds_may_have_any_name(name):
    assert read_measurements({name: MINUTES, "q0": MINUTES}, time=name).names == ("q0",)


@pytest.mark.parametrize(
    ("times", "remedy"), [([0.0, 2.0, 1.0], r"sort_values\(<time>\)"), ([0.0, 1.0, 1.0], r"groupby\(<time>\).mean\(\)")]
)
def test_a_record_out_of_order_is_told_what_to_do(times, remedy):
    """Assert that of several runs in one table it is told what would mix them."""
    with pytest.raises(ValueError, match=f"at row 2 .*: in pandas `table.{remedy}.*several runs, that would mix them"):
        read_measurements({"t": times, "q0": times})


@pytest.mark.parametrize("together", [list, tuple])
def test_several_tables_are_told_where_several_records_are_shown(together):
    run = pandas.DataFrame({"t": MINUTES, "q0": MINUTES})
    with pytest.raises(TypeError, match='but is (list|tuple). Several runs .* "Several records at once" in docs'):
        read_measurements(together([run, run]))


def test_an_event_that_was_not_seen_is_not_to_be_left_out():
    """That was the advice: the events after it were compared with the wrong ones."""
    with pytest.raises(ValueError, match='give NaN, and `missing="skip"`. To leave it out would shift those after it'):
        measurements(event_times=[1.0, np.nan, 2.0], event_sigma=1e-3)
    with pytest.raises(ValueError, match="falls back at row 1 .*: sort them, with their `event_sigma`"):
        measurements(event_times=[2.0, 1.0], event_sigma=1e-3)


@pytest.mark.slow
def test_a_guess_that_fails_tells_the_horizon_and_the_record():
    """Milliseconds since another moment, say: no motion reaches their end."""
    late = 1.7e9 + np.arange(3.0)
    with pytest.raises(ValueError, match=r"begins at t = 0 and ends at 1.7e\+09, its record goes from t = 1.7e\+09 to"):
        fit(BouncingBall(), (late, np.ones(3)), parameters=["height"], max_events=4, max_steps=64)
