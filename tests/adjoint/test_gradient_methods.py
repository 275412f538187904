"""The gradient methods of this package beside each other: in every table by default, each right to its accuracy."""

import inspect

import diffrax
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from jaxtyping import Array

import hybridsens as hs
from hybridsens.comparison.compare import compare, relative_error
from hybridsens.comparison.differentiate import value_and_gradient
from hybridsens.comparison.functional import functional
from hybridsens.comparison.gradient_methods import DEFAULT_ADJOINTS, name_with_settings, our_methods
from hybridsens.parameters import flatten_parameters
from tests.problems import reference_scenes
from tests.problems.references import RECORDS


@pytest.fixture(scope="module")
def gradients():
    """P2 at 1e-8 by every default method: name -> gradient."""

    def cost(p, simulate):
        scene = reference_scenes.elastic_stop(*p)
        return simulate(scene, scene.initial_state(), t1=20.0, running_cost=lambda s, t, q, v: q @ q).cost

    parameters = flatten_parameters(jnp.array(RECORDS["P2"]["p"]))
    methods = our_methods(DEFAULT_ADJOINTS, dict(rtol=1e-8, atol=1e-8, max_events=16, max_steps=1024))
    runs = {m.name: value_and_gradient(functional(parameters, cost, m.simulate), m.mode) for m in methods}
    return {name: np.asarray(run(parameters.vector)[1]) for name, run in runs.items()}


@pytest.mark.slow
def test_every_method_is_in_a_comparison_and_right_to_1e_7(gradients):
    """At tolerance 1e-8, on the elastic stop with five impacts; the continuous costate takes the same tolerance."""
    assert inspect.signature(compare).parameters["adjoints"].default == DEFAULT_ADJOINTS
    assert list(gradients) == [
        "Replay", "ForwardSensitivities", "ContinuousCostate", "ContinuousCostate(state='backward')", "DiffraxAdjoint",
    ]  # fmt: skip
    known = np.array([float(entry) for entry in RECORDS["P2"]["dJ"][0]])
    for method, gradient in gradients.items():
        assert relative_error(gradient, known) < 1e-7, method


@pytest.mark.slow
def test_discrete_methods_share_one_gradient_and_the_continuous_ones_do_not(gradients):
    """Replay and Diffrax's adjoint agree to rounding, forward sensitivities but for the steps that either cuts; the
    costate is off by its tolerance."""
    far = {method: relative_error(gradient, gradients["Replay"]) for method, gradient in gradients.items()}
    assert far["ForwardSensitivities"] < 5e-9 and far["DiffraxAdjoint"] < 1e-12
    for method in ("ContinuousCostate", "ContinuousCostate(state='backward')"):
        assert 1e-12 < far[method] < 1e-7


@pytest.mark.parametrize("adjoint", [diffrax.ImplicitAdjoint(), diffrax.BacksolveAdjoint(), diffrax.ForwardMode()])
def test_an_adjoint_of_diffrax_that_is_not_discrete_is_refused(adjoint):
    """That of a steady state gave a gradient that was wrong without a word."""
    with pytest.raises(ValueError, match=r"must be RecursiveCheckpointAdjoint\(\) or DirectAdjoint\(\)"):
        hs.DiffraxAdjoint(adjoint)


def test_a_costate_follows_the_tolerance_unless_it_has_its_own():
    """By name and by setting; methods without tolerances stay what they are."""
    own = hs.ContinuousCostate(rtol=1e-11)
    assert own.at_tolerance(1e-6) == own and name_with_settings(own) == "ContinuousCostate(rtol=1e-11)"
    moved = hs.ContinuousCostate(state="backward").at_tolerance(1e-6)
    assert moved == hs.ContinuousCostate(1e-6, 1e-6, "backward")
    assert hs.Replay().at_tolerance(1e-6) == hs.Replay()
    assert name_with_settings(hs.DiffraxAdjoint(diffrax.DirectAdjoint())) == "DiffraxAdjoint(adjoint=DirectAdjoint())"


def test_solvers_with_other_settings_have_other_names():
    """Points of a work-precision study are kept by these names: one's would stand for the other's."""
    chord = diffrax.VeryChord(rtol=1e-3, atol=1e-3)
    names = [name_with_settings(solver) for solver in (diffrax.Kvaerno5(), diffrax.Kvaerno5(root_finder=chord))]
    assert names == ["Kvaerno5", "Kvaerno5(root_finder=VeryChord(rtol=0.001, atol=0.001))"]


class Damped(hs.AbstractScene):
    """v' = -c v + cos(3 t), with a wall that is never reached."""

    damping: Array

    sustained_contact = False

    def mass_matrix(self, q):
        return jnp.eye(1)

    def force(self, t, q, v):
        return -self.damping * v + jnp.cos(3 * t)

    def gap(self, t, q):
        return 100 + q

    def restitution(self):
        return jnp.zeros(1)


class Complex(Damped):
    """The damping is that of a complex number's size."""

    def force(self, t, q, v):
        return -jnp.abs(self.damping) * v


@pytest.mark.slow
@pytest.mark.filterwarnings("ignore:Complex dtype support")  # Diffrax's own, of any complex number
def test_a_complex_parameter_has_its_gradient_and_is_refused_by_a_costate():
    """q(1) = (1 - e^-c) / c with c = |z|, whose gradient is conj(z) / c in JAX's convention. The costate's equation was
    refused by JAX, in words about the types of arrays; that of `Replay` took a complex number for a real size."""
    run = lambda scene, adjoint: hs.simulate(scene, hs.State([0.0], [1.0]), t1=1.0, adjoint=adjoint).final.q[0]
    scene, by_c = Complex(jnp.array(3.0 + 4.0j)), (6 * np.exp(-5.0) - 1) / 25
    np.testing.assert_allclose(jax.grad(run)(scene, hs.Replay()).damping, by_c * (3 - 4j) / 5, rtol=1e-6)
    with pytest.raises(NotImplementedError, match="must have real parameters"):
        jax.grad(run)(scene, hs.ContinuousCostate())


@pytest.mark.slow
def test_a_state_that_cannot_be_integrated_backward_is_warned_of():
    """An implicit solver takes steps of many times 1/c: backward, errors grow by e^(c h). With c = 1 all is well.

    From rest q(t) = (c/3 sin 3t - cos 3t + e^(-c t)) / (c^2 + 9).
    """

    def cost(c):
        start, backward = hs.State(jnp.zeros(1), jnp.zeros(1)), hs.ContinuousCostate(state="backward")
        motion = hs.simulate(Damped(c), start, t1=3.0, solver=diffrax.Kvaerno5(), adjoint=backward, throw=False)
        return motion.final.q[0]

    exact = jax.grad(lambda c: (c / 3 * jnp.sin(9.0) - jnp.cos(9.0) + jnp.exp(-3 * c)) / (c**2 + 9))
    slope = jax.jit(jax.grad(cost))
    assert float(slope(jnp.array(1.0))) == pytest.approx(float(exact(1.0)), rel=1e-6)
    jax.effects_barrier()  # a warning would have been an error here
    with pytest.warns(UserWarning, match="too dissipative to be integrated backward"):
        jax.block_until_ready(slope(jnp.array(1e3)))
        jax.effects_barrier()
