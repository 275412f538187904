"""What the report of a fit says of parameters that are known badly, of events, and how measurements print."""

from types import SimpleNamespace

import numpy as np

from hybridsens.estimation import measurements
from hybridsens.estimation.report import _directions, _sequence, _starts, _way
from hybridsens.estimation.uncertainty import weak_directions

LABELS = ("log_ka", "log_cl")


def said_of(values, covariance):
    """Of a fit with these values, whose parameters are all determined and free of bounds."""
    sizes = np.sqrt(np.diag(covariance))
    fitted = SimpleNamespace(
        labels=LABELS,
        values=values,
        standard_errors=dict(zip(LABELS, sizes, strict=True)),
        correlation=np.array(covariance) / np.outer(sizes, sizes),
        weak_directions=lambda: weak_directions(LABELS, values, covariance),
        on_bound=(),
        uncertainty=SimpleNamespace(unseen=(), null_directions=[]),
    )
    return list(_directions(fitted))


def test_a_logarithm_near_zero_is_not_called_hardly_determined():
    """Of an absorption rate of 1 its logarithm is 0, and 0.15 is a small error of it."""
    (remark,) = said_of([0.003, 1.6], [[0.15**2, 0.0], [0.0, 0.08**2]])
    assert remark.startswith("hardly told from 0: log_ka, which is 0.003 with a standard error of 0.15 ")


def test_a_direction_of_several_parameters_still_is():
    """Two parameters of which only the sum is known."""
    remark, _ = said_of([1.0, 1.0], [[1.0, -0.99], [-0.99, 1.0]])
    assert remark.startswith("hardly determined (standard error 1.4 of relative change): log_")


def test_an_error_of_many_values_hides_none_of_the_others():
    """Next to 0, with an error of 1e10 values: e, known to half a percent, was called hardly told from 0."""
    (remark,) = said_of([1e-12, 0.7], [[0.02**2, 5e-5], [5e-5, 0.004**2]])
    assert remark.startswith("hardly told from 0: log_ka") and "log_cl" not in remark


def test_several_starts_tell_the_way_of_the_best():
    """The descent goes on from there, and often has nothing left to do."""
    starts = SimpleNamespace(loss=np.array([3.0, 0.5, np.inf]), iterations=np.array([4, 11, 0]))
    fitted = SimpleNamespace(starts=starts, iterations=0, loss=0.5, history=[SimpleNamespace(loss=0.5, stage="full")])
    assert _way(fitted) == "11 iterations of the best of 3 starts: loss 0.5"
    fitted.starts, fitted.iterations = None, 1
    assert _way(fitted) == "1 iteration: loss 0.5 -> 0.5"
    fitted.history[0].stage = "horizon 1"  # its loss is that of the beginning of the record
    assert _way(fitted) == "1 iteration: loss 0.5"


def test_one_start_alone_at_the_best_loss_asks_for_more():
    """And starts that failed, for bounds."""
    starts = lambda *loss: SimpleNamespace(loss=np.array(loss), iterations=np.arange(3, 3 + len(loss)))
    assert _starts(starts(3.0, 0.5, np.inf)) == (
        "3 starts of 3 to 5 iterations: 1 alone ended within 1 % of the best loss, so take more; 1 failed (`bounds` "
        "keep to where motions exist)"
    )
    assert _starts(starts(0.5, 0.5)) == "2 starts of 3 to 4 iterations: 2 ended within 1 % of the best loss; 0 failed"


def test_events_that_repeat_are_counted():
    """Forty impacts of one contact are one word; a cycle is shown as far as one reads it."""
    name = lambda kind, number: f"{kind} {number}"
    impacts = (("impact", 0),) * 40 + (("capture", 0),)
    assert _sequence(impacts, name) == "41 (40 x impact 0, capture 0)"
    assert _sequence(tuple(("switch", k % 2) for k in range(20)), name).endswith("switch 0, switch 1, ...)")
    assert _sequence((), name) == "none"


def test_measurements_are_printed_in_words():
    """Of each column how many values there are and between which; of events those that were seen."""
    record = measurements([0.0, 0.5, 2.0], [[1.0, 5.0], [np.nan, 6.0], [3.0, 7.0]], sigma=0.1, names=["x", "y [m]"],
                          missing="skip", event_times=[0.25, np.nan], event_sigma=0.01)  # fmt: skip
    assert str(record).splitlines() == [
        "3 times from 0 to 2, with sigmas", "x: 2 values from 1 to 3", "y [m]: 3 values from 5 to 7",
        "event times: 1 of 2 seen, [0.25]",
    ]  # fmt: skip
    assert str(measurements(event_times=[0.25], event_sigma=0.01)) == "event times: 1 of 1 seen, [0.25]"
