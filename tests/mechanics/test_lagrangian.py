"""A scene of energies is the scene that one would have written by hand, at an instant and over a whole motion."""

import warnings

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from jax import Array

import hybridsens as hs
from tests.problems.energies import PAIRS, as_energies


@pytest.mark.parametrize(("by_hand", "energies"), PAIRS, ids=lambda scene: scene.__name__)
def test_mass_matrix_force_and_gap_are_those_written_by_hand(by_hand, energies):
    """At random states, to rounding."""
    scene = by_hand()
    twin = as_energies(energies, scene)
    dof = scene.initial_state().q.shape[0]
    for q, v in np.random.default_rng(1).normal(size=(5, 2, dof)):
        q, v, t = jnp.asarray(q), jnp.asarray(v), jnp.asarray(0.3)
        np.testing.assert_allclose(twin.mass_matrix(q), scene.mass_matrix(q), rtol=1e-14, atol=1e-14)
        np.testing.assert_allclose(twin.force(t, q, v), scene.force(t, q, v), rtol=1e-13, atol=1e-13)
        np.testing.assert_allclose(twin.gap(t, q), scene.gap(t, q), rtol=1e-14, atol=1e-14)


@eqx.filter_jit
def _value_and_gradient(scene):
    def end(scene):
        motion = hs.simulate(scene, scene.initial_state(), t1=3.0, rtol=1e-9, atol=1e-9)
        return jnp.sum(motion.final.q) + motion.events.time[0], motion

    return eqx.filter_value_and_grad(end, has_aux=True)(scene)


@pytest.mark.slow
@pytest.mark.parametrize(("by_hand", "energies"), PAIRS, ids=lambda scene: scene.__name__)
def test_motion_and_gradient_are_those_of_the_scene_written_by_hand(by_hand, energies):
    """Impacts of a double pendulum and of a damped one, and the gradient by all parameters, to 1e-12."""
    scene = by_hand()
    (_, motion), gradient = _value_and_gradient(scene)
    (_, of_energies), gradient_of_energies = _value_and_gradient(as_energies(energies, scene))
    assert motion.events.count == of_energies.events.count > 1
    n = int(motion.events.count)
    np.testing.assert_allclose(of_energies.events.time[:n], motion.events.time[:n], rtol=1e-12)
    np.testing.assert_allclose(of_energies.events.impulse[:n], motion.events.impulse[:n], rtol=1e-12, atol=1e-12)
    np.testing.assert_allclose(of_energies.final.q, motion.final.q, rtol=1e-12)
    expected = jnp.stack(jax.tree.leaves(gradient))
    found = jnp.stack(jax.tree.leaves(gradient_of_energies))
    np.testing.assert_allclose(found, expected, rtol=1e-12, atol=1e-12 * np.max(np.abs(expected)))


class _Bead(hs.LagrangianScene):
    """A bead on a hoop that is turned at a rate w: T has a term without v, whose force drives the bead outward."""

    w: Array
    drive: Array

    def kinetic_energy(self, q, v):
        return 0.5 * jnp.sum(v**2 + (self.w * jnp.sin(q)) ** 2) + jnp.sum(q * v)  # the last is d(q^2 / 2) / dt

    def applied_force(self, t, q, v):
        return self.drive * jnp.cos(t) - v[:1]

    def gap(self, t, q):
        return q + 10.0

    def restitution(self):
        return jnp.ones(1)


def test_terms_of_lower_order_in_the_velocity():
    """T0(q) gives its gradient as a force, w^2 sin q cos q; the rate of a function of q gives none."""
    bead = _Bead(jnp.array(3.0), jnp.array(0.7))
    t, q, v = jnp.array(0.4), jnp.array([0.3]), jnp.array([1.1])
    np.testing.assert_allclose(bead.mass_matrix(q), [[1.0]], rtol=1e-15)
    expected = 9 * np.sin(0.3) * np.cos(0.3) + 0.7 * np.cos(0.4) - 1.1
    np.testing.assert_allclose(bead.force(t, q, v), [expected], rtol=1e-14)
    np.testing.assert_allclose(bead.energy(q, v), 0.5 * (1.1**2 + (3 * np.sin(0.3)) ** 2) + 0.33, rtol=1e-14)


class _Fast(_Bead):
    def kinetic_energy(self, q, v):
        return -jnp.sqrt(1 - v @ v / 100)


class _OfShapeOne(_Bead):
    def kinetic_energy(self, q, v):
        return 0.5 * v * v


@pytest.mark.parametrize(("scene", "message"), [(_Fast, "quadratic in v"), (_OfShapeOne, "must return a scalar")])
def test_what_is_no_kinetic_energy_is_refused(scene, message):
    """A relativistic mass has no mass matrix M(q), and an energy is one number."""
    with pytest.raises(ValueError, match=message):
        hs.simulate(scene(jnp.array(1.0), jnp.array(0.0)), hs.State([0.0], [0.0]), t1=1.0)


class Lifted(hs.LagrangianScene):
    """A mass that falls."""

    def kinetic_energy(self, q, v):
        return v @ v / 2

    def gap(self, t, q):
        return q

    def restitution(self):
        return jnp.ones(1)


def test_a_force_that_takes_the_place_of_all_others_is_told():
    """Unless it builds on them, or the mass matrix is written by hand too."""
    define = lambda **methods: type("Written", (Lifted,), methods)
    push = lambda self, t, q, v: jnp.ones(1)
    with pytest.warns(UserWarning, match="Written defines `force`, which takes the place .* Is `applied_force` meant"):
        define(force=push)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        define(force=push, mass_matrix=lambda self, q: jnp.eye(1))
        define(force=lambda self, t, q, v: 1 + hs.LagrangianScene.force(self, t, q, v))


def test_a_force_under_a_name_of_its_own_is_told():
    """Unless a method reads it, or the scene writes `applied_force` too."""
    define = lambda base=Lifted, **methods: type("Written", (base,), methods)
    push = lambda self, t, q, v: jnp.ones(1)
    for name in ("external_force", "generalized_forces", "motor_torque"):
        with pytest.warns(UserWarning, match=f"Written defines `{name}`, which none .* Is `applied_force` meant"):
            define(**{name: push})
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        define(external_force=push, applied_force=push)
        define(external_force=push, gap=lambda self, t, q: self.external_force(t, q, q))
        define(external_power=push)
