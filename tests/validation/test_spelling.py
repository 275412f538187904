"""A method that nothing reads, because its name is nearly that of an optional one, is told when its class is made."""

import warnings

import jax.numpy as jnp
import pytest

import hybridsens as hs
from hybridsens.validation.spelling import did_you_mean


def class_with(base, **named):
    return type("Written", (base,), {"__module__": __name__, **named})


NEAR = [
    (hs.LagrangianScene, "applied_forces", "applied_force"),
    (hs.LagrangianScene, "potential_energies", "potential_energy"),
    (hs.AbstractScene, "jump_time", "jump_times"),
    (hs.AbstractSwitchedScene, "jump_time", "jump_times"),
    (hs.AbstractHybridSystem, "scheduled_time", "scheduled_times"),
]


@pytest.mark.parametrize(("base", "name", "meant"), NEAR)
def test_a_method_whose_name_is_nearly_an_optional_one_is_told(base, name, meant):
    with pytest.warns(UserWarning, match=f"Written defines `{name}`, which nothing reads. Is `{meant}` meant"):
        class_with(base, **{name: lambda self: None})


@pytest.mark.parametrize(("name", "meant"), [("forces", "force"), ("initialstate", "initial_state"), ("gaps", "gap")])
def test_so_is_one_beside_that_of_the_class_before(name, meant):
    """Else the motion would be that of the class before, in silence."""
    with pytest.warns(UserWarning, match=f"Written defines `{name}`, which nothing reads. Is `{meant}` meant"):
        class_with(hs.scenes.BouncingBall, **{name: lambda self: None})


def test_so_is_a_setting_of_the_class():
    with pytest.warns(UserWarning, match="`sustained_contacts`, which nothing reads. Is `sustained_contact` meant"):
        class_with(hs.AbstractScene, sustained_contacts=False)


def test_names_of_one_s_own_are_not():
    """Helpers beside the optional method itself, and such as are near to each other or to what must be written."""
    method = lambda self: None
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        named = dict.fromkeys(("force", "forces", "gap", "gaps", "jump_times", "jump_time", "part_1", "part_2"), method)
        first = class_with(hs.AbstractScene, **named, coordinate=method)
        class_with(first, part_3=method, gap_of=jnp.zeros(1))


def test_a_name_in_other_letters_is_near():
    """Capitals are a common slip; of names that differ in them alone the first one is meant."""
    assert did_you_mean("Up", ["up", "down"]) == " Did you mean 'up'?"
    assert did_you_mean(["wieght", "Q0"], ["Weight", "q0"]) == " Did you mean 'Weight', 'q0'?"
    assert did_you_mean("speed", ["mass"]) == ""
