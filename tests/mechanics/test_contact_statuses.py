"""Statuses of any motion know no contacts; mechanics adds its own, and all are of one kind."""

import importlib
import re
from pathlib import Path

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import hybridsens as hs
from hybridsens.mechanics.status import ContactStatus


def test_statuses_are_of_one_kind_and_mechanics_adds_its_own():
    """Those of any motion say nothing of contacts by themselves; what they mean in a scene is told behind it."""
    module = importlib.import_module("hybridsens.status")
    words = re.compile("contact|impact|captur|penetrat|restitution|mass|gap", re.IGNORECASE)
    assert not words.search(Path(module.__file__).read_text())
    added = {"gap_not_smooth", "penetration", "bad_restitution", "bad_mass_matrix"}
    assert added == {name for name in hs.Status.names() if name in vars(ContactStatus)}
    assert hs.Status.penetration == ContactStatus.penetration and hs.Status.penetration != hs.Status.grazing
    assert "capture_speed" in hs.Status.max_events_reached.message
    with pytest.raises(TypeError, match="must be compared with a status"):
        hs.Status.successful == 0  # noqa: B015
    with pytest.raises(TypeError, match="or with an array of integer codes, .* but is with 'successful'"):
        hs.Status.successful == "successful"  # noqa: B015


class Between(hs.AbstractScene):
    """A ball between a floor and a roof."""

    contacts = ("floor", "roof")
    e: jax.Array

    def mass_matrix(self, q):
        return jnp.eye(1)

    def force(self, t, q, v):
        return -9.81 * jnp.ones(1)

    def gap(self, t, q):
        return jnp.stack([q[0], 2.0 - q[0]])

    def restitution(self):
        return jnp.stack([self.e, 2 * self.e])


SHOWN = [
    (0.4, 2.1, {}, r"^The motion could not begin \(penetration\): .* The gap of contact roof is -0.1.$"),
    (0.8, 1.0, {}, "The restitution of contact roof is 1.6.$"),
    (0.4, 1.0, dict(t1=-1.0), r"^The motion could not begin \(bad_horizon\): .* Here t0 is 0 and t1 is -1.$"),
    pytest.param(
        0.4, 1.0, dict(ts=[0.5, 0.3]), r"^The motion could not begin .*: .* Here ts\[1\] is 0.3, t0 is 0 and t1 is 2.$",
        marks=pytest.mark.slow,
    ),
    (
        0.4, 1.0, dict(t1=0.3, ts=np.arange(4) * 0.1),
        r"Here ts\[3\] is 0.30000000000000004, t0 is 0 and t1 is 0.3. Rounding put it there: give `jnp.clip",
    ),
    (0.4, 1.0, dict(t1=0.3, ts=np.arange(8) * 0.1), r"Here ts\[3\] is 0.30000000000000004, .* 8 times 5 lie outside.$"),
    pytest.param(
        0.4, 1.0, dict(max_events=1), "did not reach its end .*: .* The last events: t = 0.4515.*, impact of floor.$",
        marks=pytest.mark.slow,
    ),
]


@pytest.mark.parametrize(("e", "height", "given", "message"), SHOWN)
def test_the_values_that_a_motion_failed_by_are_shown(e, height, given, message):
    """Which contact, which time, and how far off; while a derivative is taken too, but not where all is compiled."""
    given = dict(t1=2.0, max_events=8) | given
    ts = jnp.array(given.pop("ts")) if "ts" in given else None
    run = lambda e: hs.simulate(Between(e), hs.State([height], [0.0]), ts=ts, **given).final.q[0]
    with pytest.raises(hs.SimulationError, match=message):
        run(jnp.array(e))
    if not given["max_events"] == 1:
        return
    with pytest.raises(hs.SimulationError) as caught:
        jax.grad(run)(jnp.array(e))
    assert "last events" in str(caught.value)


@pytest.mark.parametrize(
    ("mass", "shown"),
    [
        (lambda x: [[2.0, 0.0], [x, 2.0]], r"\(bad_mass_matrix\): .* M\[0, 1\] is 0 and M\[1, 0\] is 0.4[0-9]*.$"),
        (lambda x: [[1.0 - 2.5 * x, 0.0], [0.0, 1.0]], r"\(step_size_underflow\): .* eigenvalues from .* to 1.$"),
    ],
)
def test_a_mass_matrix_that_is_right_by_chance_where_it_begins_is_told(mass, shown):
    """One that is not symmetric but at x = 0, though no event asks, and one that becomes singular."""

    class Pulled(Between):
        def mass_matrix(self, q):
            return jnp.array(mass(q[0] - 1.0))

        def force(self, t, q, v):
            return jnp.array([0.1, 0.0])

    with pytest.raises(hs.SimulationError, match=shown):
        hs.simulate(Pulled(0.4), hs.State([1.0, 0.0], [0.5, 0.0]), t1=0.9)


@pytest.mark.parametrize(
    ("mass", "shown"),
    [
        ([[1.0, 0.5], [0.4, 1.0]], r"M\[0, 1\] is 0.5 and M\[1, 0\] is 0.4"),
        pytest.param([[1.0, 2.0], [2.0, 1.0]], "its smallest eigenvalue is -1", marks=pytest.mark.slow),
    ],
)
def test_what_is_wrong_with_a_mass_matrix_is_shown(mass, shown):
    """Entries that are not symmetric, by their places, or the eigenvalue that is not positive."""

    class Wrong(Between):
        def mass_matrix(self, q):
            return jnp.array(mass)

        def force(self, t, q, v):
            return jnp.zeros(2)

    with pytest.raises(hs.SimulationError, match=rf"\(bad_mass_matrix\): .* At q = \[1. 0.\] {shown}.$"):
        hs.simulate(Wrong(0.4), hs.State([1.0, 0.0], [0.0, 0.0]), t1=1.0)
