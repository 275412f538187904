"""A check of many parameters: of some alone, and a report that one can read."""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest

import hybridsens as hs
from hybridsens.comparison.check_report import Cause, GradientCheck, ParameterCheck
from hybridsens.parameters import flatten_parameters


class Model(eqx.Module):
    mass: jax.Array
    weight: jax.Array


def _checked(count, doubtful=()):
    verdict = lambda k: "differences disagree" if k in doubtful else ""
    entry = lambda k: ParameterCheck(f"w[{k}]", 1.0, 1.0, 1.0, 0.0, 1.0, verdict(k))
    names = tuple(f"w[{k}]" for k in doubtful)
    causes = (Cause("any", names, (), "of that", "that"),) if doubtful else ()
    return str(GradientCheck(tuple(map(entry, range(count))), (), causes)).splitlines()


def test_chosen_parameters_alone_are_moved():
    """By the name of an array or of an entry, in any spelling; the others keep their values."""
    model = Model(jnp.array(1.0), jnp.arange(6.0).reshape(2, 3))
    chosen = flatten_parameters(model).only(["weight[1,2]", "mass"])
    assert chosen.names == ("mass", "weight[1, 2]") and chosen.vector.tolist() == [1.0, 5.0]
    moved = jax.jit(chosen.rebuild)(jnp.array([7.0, 8.0]))
    assert float(moved.mass) == 7.0 and moved.weight.tolist() == [[0.0, 1.0, 2.0], [3.0, 4.0, 8.0]]
    assert len(flatten_parameters(model).only(["weight"]).names) == 6
    for wrong, told in ((["wight"], "Did you mean 'weight'"), ([], r"but are \[\]"), (["weight[2, 0]"], "but are")):
        with pytest.raises(ValueError, match=rf"names among mass, weight, or of their entries.*{told}"):
            flatten_parameters(model).only(wrong)


def test_of_many_parameters_the_doubtful_ones_are_shown():
    """Of 40 all; of 371 twenty rows, and a line that counts the others. Names are told as far as one reads them."""
    assert sum("w[" in line for line in _checked(40)) == 40
    many = _checked(371)
    assert sum("w[" in line for line in many) == 20 and "... and 351 more, of which 0 are in doubt" in many
    wrong = _checked(371, doubtful=range(100, 200))
    assert wrong[1].split()[0] == "w[100]" and "... and 351 more, of which 80 are in doubt" in wrong
    assert sum("w[107], ... (100 in all)" in line for line in [" ".join(wrong).replace("     ", " ")]) == 1
    assert len(wrong) < 60


def test_of_many_parameters_those_with_a_derivative_are_shown():
    """The first twenty may be times, by which nothing changes."""
    entry = lambda k: ParameterCheck(f"w[{k}]", *3 * [float(k > 50)], 0.0, 1.0, "")
    rows = str(GradientCheck(tuple(map(entry, range(61))), ())).splitlines()[1:21]
    assert [row.split()[0] for row in rows[:11]] == [f"w[{k}]" for k in (*range(51, 61), 0)]


@pytest.mark.slow
def test_one_entry_is_checked_by_itself():
    """Of three parameters of a falling ball one is asked for, and it is right."""
    cost = lambda scene, simulate: simulate(scene, scene.initial_state(), t1=0.8).final.q[0]
    check = hs.check_gradient(hs.scenes.BouncingBall(), cost, parameters="height", max_events=32, max_steps=1024)
    assert [entry.parameter for entry in check.parameters] == ["height"] and np.isfinite(check.parameters[0].reference)
    assert check.ok, str(check)
