"""A flag of the mode that is given as a whole number never turns false by `~`."""

import jax.numpy as jnp
import pytest

import hybridsens as hs
from hybridsens.validation.asked import Asked
from hybridsens.validation.transition import must_not_negate


def test_a_flag_that_is_given_as_a_number_is_refused():
    """The heater stayed on for ever, since -2 and 1 both count as true."""
    with pytest.raises(TypeError, match="`transition` must not apply `~` to a whole number .* Begin in a mode of True"):
        hs.solve(hs.systems.Thermostat(), 20.0, 1, t1=1.0)


BITS = {
    "masked": lambda mode: ~mode & 1,
    "turned": lambda mode: mode ^ 1,
    "asked": lambda mode: jnp.where(~(mode > 0), 1, 0),
}


@pytest.mark.parametrize("name", BITS)
def test_numbers_that_turn_rightly_are_not(name):
    must_not_negate(Asked("transition(mode)", BITS[name]), jnp.array(1))
