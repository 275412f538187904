"""What `simulate` says of names that do not fit, and of impacts that accumulate where nothing may stay closed."""

import jax.numpy as jnp
import pytest

import hybridsens as hs
from tests.problems.balls import RestlessBall

BALL = jnp.array(9.81), jnp.array(0.5)
START = hs.State([1.0], [0.0])


class Misnamed(RestlessBall):
    coordinates = ("height [m]", "width [m]")


class TwoFloors(RestlessBall):
    contacts = ("floor", "ceiling")


@pytest.mark.parametrize("kind, what", [(Misnamed, "coordinates"), (TwoFloors, "contacts")])
def test_names_that_do_not_fit_are_refused_before_the_motion(kind, what):
    with pytest.raises(ValueError, match=f"`{what}`"):
        hs.simulate(kind(*BALL), START, t1=1.0)


def test_accumulating_impacts_name_the_setting_of_the_scene():
    with pytest.raises(hs.SimulationError, match="The scene sets `sustained_contact = False`: set it to True"):
        hs.simulate(RestlessBall(*BALL), START, t1=3.0)
