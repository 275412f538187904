"""The picture and the table of a fit, and what the fitted motion shows between the measurements."""

from types import SimpleNamespace

import numpy as np
import pytest

from hybridsens.estimation.plot import _plot_convergence, plot_fit
from hybridsens.plot.figure import new_figure


def test_the_plot_shows_data_residuals_and_loss(near):
    """Assert that the figure has three panels, with a dashed line for each of the 5 events."""
    above, _, _ = near.plot().axes
    assert sum(line.get_linestyle() == "--" for line in above.lines) == 5
    assert above.get_xlabel() == "time [s]"


def test_the_plot_s_line_goes_through_the_impacts(near):
    """Between the times measured a straight line would cut them: the fitted mass never goes beyond its stop, and is
    drawn at the stop at each of the 5 impacts."""
    line = near.plot().axes[0].lines[0]
    time, place = line.get_data()
    np.testing.assert_allclose(place[np.isin(time, near.trajectory.events.time[:5])], near.scene.distance, rtol=1e-7)
    assert place.max() <= near.scene.distance + 1e-7 and time.size > 400


def test_event_times_alone_have_no_empty_panel():
    """Assert that residuals come first, with a cross for each event time and a line for each event."""
    happened = SimpleNamespace(time=np.array([0.5, 1.0, np.inf]), count=2)
    lines = [SimpleNamespace(loss=loss, stage="all", sequence_changed=False) for loss in (2.0, 1.0)]
    result = SimpleNamespace(
        data=SimpleNamespace(names=(), event_times=np.array([0.5, 1.1])), event_residuals=np.array([0.0, -0.1]),
        scene=None, trajectory=SimpleNamespace(events=happened), history=lines, starts=None,
    )  # fmt: skip
    above, _ = plot_fit(result).axes
    assert above.lines[0].get_xdata().tolist() == [0.5, 1.1]
    assert sum(line.get_linestyle() == "--" for line in above.lines) == 2
    assert above.get_title(loc="left").endswith("; dashed lines are events")


@pytest.mark.slow
def test_what_a_fit_predicts_at_other_times(near):
    """Assert that it is what it shows at the times measured, in any order, and that other times are refused."""
    shown = near.predict(near.data.times[::-1])
    np.testing.assert_allclose(shown[::-1], near.predictions, rtol=1e-7, atol=1e-9)
    late, early = near.data.times[[-1, 0]]
    square = near.predict([[late, early], [early, early]])
    np.testing.assert_array_equal(square, [[shown[0], shown[-1]], [shown[-1], shown[-1]]])
    np.testing.assert_array_equal(near.predict(late), shown[0])
    with pytest.raises(ValueError, match="Times must lie within"):
        near.predict([near.horizon[1] + 1.0])


def test_the_parameters_are_a_table(near):
    """With values, guesses, errors and intervals by name; and a fit that is to be saved as text is told of it."""
    pytest.importorskip("pandas")
    table = near.to_pandas()
    assert tuple(table.index) == near.labels and table.index.name == "parameter"
    assert table["standard_error"].to_dict() == near.standard_errors
    assert {name: (row.low, row.high) for name, row in table.iterrows()} == near.intervals()
    with pytest.raises(ValueError, match=r"of a fit are written by `.to_pandas\(\).to_csv\(path\)`"):
        near.save("fit.json")


def test_several_starts_are_drawn_by_the_losses_they_ended_at():
    """In their order, without those that failed: which of them found the same minimum."""
    starts = SimpleNamespace(loss=np.array([3.0, 0.5, np.inf, 0.6]), converged=np.array([False, True, False, True]))
    fitted = SimpleNamespace(starts=starts, loss=0.5, history=[])
    axes = new_figure((8, 3)).subplots()
    _plot_convergence(axes, fitted)
    drawn = {str(line.get_label()): np.asarray(line.get_ydata()).tolist() for line in axes.lines}
    assert drawn["converged"] == [0.5, 0.6] and drawn["not converged"] == [3.0] and drawn["the fit"] == [0.5, 0.5]
