"""Every ready-made system against its motion in 30 digits: event times, final state, cost, and their derivatives by
every parameter, in reverse and forward mode and by finite differences."""

import jax.numpy as jnp
import numpy as np
import pytest
from jax.flatten_util import ravel_pytree

from hybridsens.flattened import FlattenedSystem
from hybridsens.numerics.shapes import Shapes
from hybridsens.systems import SYSTEMS
from tests.closeness import assert_close
from tests.problems.system_numbers import assert_rows_close, forward_mode, reverse_mode, truth


def differences(value, p, h):
    """Central differences of fourth order; the steps are relative to the parameters."""
    columns = []
    for k in range(p.size):
        step = np.zeros(p.size)
        step[k] = h * max(abs(p[k]), 0.1)
        at = [np.asarray(value(p + m * step)) for m in (-2, -1, 1, 2)]
        columns.append((at[0] - 8 * at[1] + 8 * at[2] - at[3]) / (12 * step[k]))
    return np.array(columns).T


def cases(*quick):
    """All systems, of which those that are not named belong to the slow suite."""
    return [pytest.param(name, marks=[pytest.mark.slow] * (name not in quick)) for name in SYSTEMS]


@pytest.mark.parametrize("name", cases("thermostat", "dosing"))
def test_a_system_has_its_exact_motion_and_gradient(name):
    """In reverse mode at tolerance 1e-9; and finite differences at one where their noise is small."""
    expected, jacobian, count = truth(name)
    reverse, p = reverse_mode(name)
    value, gradient, events = reverse(p, 1e-9)
    assert int(events) == count
    assert_close(value, expected, 1e-8)
    assert_rows_close(gradient, jacobian)
    assert_rows_close(differences(lambda p: reverse(p, 1e-13)[0], np.asarray(p), 2e-4), jacobian)


@pytest.mark.parametrize("name", cases("thermostat"))
def test_forward_mode_has_the_same_gradient(name):
    forward, p = forward_mode(name)
    assert_rows_close(np.asarray(forward(p, 1e-9)), truth(name)[1])


@pytest.mark.parametrize("name", SYSTEMS)
def test_what_is_affine_is_not_searched(name):
    """Every guard here is affine in time and state in each mode: no step is searched for a dip that its ends hide."""
    system = SYSTEMS[name]()
    x, mode = system.initial_state(), system.initial_mode()
    vector, _ = ravel_pytree(x)
    count = system.guards(jnp.zeros(()), x, mode).shape[0]
    flat = FlattenedSystem(system, None, None, Shapes.of(x), count, None, mode)
    assert not flat.searches(jnp.zeros(()), vector)
