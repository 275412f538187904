"""What the tests of fits share: a record, and what a fit from a near guess makes of it."""

import pytest

from hybridsens.estimation import fit
from hybridsens.scenes import ElasticStop
from tests.problems.stop_record import NEAR, STOP, stop_record


@pytest.fixture(scope="session")
def record():
    """SciPy's motion of the stop, with noise, outliers and gaps."""
    return stop_record()


@pytest.fixture(scope="session")
def near(record):
    """A fit from a near guess."""
    return fit(ElasticStop(**NEAR), record, **STOP)
