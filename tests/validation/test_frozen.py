"""What is said where somebody assigns to a scene or a system."""

import dataclasses

import jax
import jax.numpy as jnp
import pytest

from hybridsens.scenes import BouncingBall
from hybridsens.systems import Thermostat
from tests.problems.sawtooth import Sawtooth


@pytest.mark.parametrize(("made", "name"), [(BouncingBall(), "weight"), (Thermostat(), "low")])
def test_a_scene_or_a_system_is_not_changed_and_says_what_to_do(made, name):
    """Assert that the message names the field and two ways to another scene; and that nothing was changed."""
    before = getattr(made, name)
    kind = type(made).__name__
    with pytest.raises(dataclasses.FrozenInstanceError, match=rf"`{name}` .* {kind}\(...\), or .*tree_at.*it\.{name}"):
        setattr(made, name, 3.0)
    assert getattr(made, name) is before


class _Undeclared(BouncingBall):
    def __init__(self, colour):
        self.colour = colour


class _Declared(Sawtooth):
    def __init__(self, slope):
        self.slope = jnp.asarray(slope, float)
        self.top = 2 * self.slope


def test_a_field_must_be_declared_to_be_set():
    """Assert that an `__init__` which sets what the class does not declare says which line is missing, and that one of
    declared fields sets them."""
    with pytest.raises(AttributeError, match="`colour` must be declared in .* _Undeclared, .*`colour: jax.Array`"):
        _Undeclared(1.0)
    assert isinstance(_Declared(1).top, jax.Array)
