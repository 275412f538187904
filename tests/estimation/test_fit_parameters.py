"""Selecting parameters, their bounds, and what the uncertainty of a linear model must be."""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy import stats

from hybridsens.estimation.motions import state_names
from hybridsens.estimation.parameters import select
from hybridsens.estimation.prepare import beginning, prior
from hybridsens.estimation.uncertainty import Noise, half_width, uncertainty
from hybridsens.parameters import flatten_parameters, parameter_places
from hybridsens.scenes import ElasticStop
from tests.problems.sawtooth import Sawtooth


class Nested(eqx.Module):
    arm: ElasticStop
    lengths: jax.Array


def test_names_reach_nested_fields_and_array_entries():
    """Assert that a nested field is called by its path and an array's entries by their index."""
    scene = Nested(ElasticStop(), jnp.array([1.0, 2.0]))
    assert {"arm.stiffness", "lengths"} <= set(parameter_places(scene))
    selection = select(scene, ["lengths", "arm.mass"])
    assert selection.labels == ("lengths[0]", "lengths[1]", "arm.mass")
    moved = selection.insert(scene, jnp.array([3.0, 4.0, 5.0]))
    assert moved.lengths.tolist() == [3.0, 4.0] and float(moved.arm.mass) == 5.0


def test_single_entries_of_an_array_are_fitted():
    """Assert that an entry is named alone, in any order, that bounds of the array or of the entry hold for it, and that
    its neighbours stay."""
    scene = Nested(ElasticStop(), jnp.arange(6.0).reshape(2, 3))
    selection = select(scene, ["lengths[1,2]", "arm.mass", "lengths[0, 1]"], {"lengths[1,2]": (4.0, 7.0)})
    assert selection.labels == ("lengths[1, 2]", "arm.mass", "lengths[0, 1]")
    assert selection.values(scene).tolist() == [5.0, 1.0, 1.0]
    moved = eqx.filter_jit(selection.insert)(scene, jnp.array([50.0, 30.0, 10.0]))
    assert moved.lengths.tolist() == [[0.0, 10.0, 2.0], [3.0, 4.0, 50.0]] and float(moved.arm.mass) == 30.0
    assert selection.lower.tolist() == [4.0, -np.inf, -np.inf]
    assert select(scene, ["lengths[0, 1]"], {"lengths[0,1]": (0.0, 2.0)}).upper.tolist() == [2.0]
    known = prior(selection, {"lengths[0,1]": (2.0, 0.5)})
    assert known.mean.tolist() == [0.0, 0.0, 2.0] and known.weight.tolist() == [0.0, 0.0, 2.0]
    with pytest.raises(ValueError, match=r"`bounds` must name each entry once, but has \['lengths\[0, 1\]', 'lengths"):
        select(scene, "lengths", {"lengths[0, 1]": (0.0, 2.0), "lengths[0,1]": (0.0, 9.0)})
    of_all = select(scene, "lengths", {"lengths": (-1.0, 9.0), "lengths[0, 0]": (-2.0, 2.0)})
    assert of_all.lower.tolist() == [-2.0] + 5 * [-1.0] and of_all.upper.tolist() == [2.0] + 5 * [9.0]


def test_a_part_stands_for_all_that_it_holds():
    """Assert that a network's name selects its weights, and that a list is written as Python or as a path has it."""
    scene = {"net": [Nested(ElasticStop(), jnp.ones(1)), {"bias": jnp.ones(2)}], "netto": jnp.ones(1)}
    assert select(scene, "net").labels[-3:] == ("net.0.lengths[0]", "net.1.bias[0]", "net.1.bias[1]")
    assert select(scene, "net[0].arm").labels == select(scene, "net.0.arm").labels
    assert select(scene, ["net[1].bias[1]"], {"net[1].bias[1]": "positive"}).labels == ("net.1.bias[1]",)
    assert flatten_parameters(scene).only(["net[0].lengths", "net[1]"]).names[-2:] == ("net.1.bias[0]", "net.1.bias[1]")
    with pytest.raises(ValueError, match="each name once, but has 'net.1.bias"):
        select(scene, ["net", "net[1].bias"])


@pytest.mark.parametrize(
    ("names", "message"),
    [
        (["lengths[2]"], r"has shape \(2,\), so its entries must be named one by one, such as 'lengths\[0\]'"),
        (["arm.mass[0]"], "is a scalar and must be named without an index"),
        (["lengths", "lengths[1]"], r"each name once, but has 'lengths\[1\]' more than once"),
        (["length[1]"], r"has \['length\[1\]'\]"),
    ],
)
def test_entries_that_are_none_are_refused(names, message):
    """Assert that the shape is told, and an entry that is fitted with its array already."""
    with pytest.raises(ValueError, match=message):
        select(Nested(ElasticStop(), jnp.ones(2)), names)


def test_a_string_is_one_name():
    """Assert that a name given as a string selects that parameter, and not its letters."""
    assert select(ElasticStop(), "mass").labels == ("mass",)


@pytest.mark.parametrize("bound", [None, "positive", (0.5, 2.0), (None, 1.5), (-1.0, None)])
def test_bounds_hold_for_every_unknown(bound):
    """Assert that p(z) stays inside its bounds for any z, grows or falls with it (between two bounds: from -pi/2 to
    pi/2), and that z(p) is the inverse of p(z)."""
    selection = select(ElasticStop(mass=1.2), ["mass"], {"mass": bound} if bound else None)
    z = jnp.linspace(-30.0, 30.0, 61)
    values = jax.vmap(lambda z: selection.to_values(z[None])[0])(z)
    assert np.all(values >= selection.lower) and np.all(values <= selection.upper)
    values = values[np.abs(z) < np.pi / 2] if bound == (0.5, 2.0) else values
    assert np.all(np.diff(values) * np.sign(values[-1] - values[0]) >= 0)
    inverse = selection.to_values(selection.from_values(jnp.array([1.2])))
    np.testing.assert_allclose(inverse, [1.2], rtol=1e-14)


@pytest.mark.parametrize("number", [1, 1.0, np.float32(1)])
@pytest.mark.parametrize("as_function", [True, False])
def test_an_initial_state_may_be_a_plain_number(number, as_function):
    """Assert that a number, real or whole, from a function or as it is, becomes an array of real numbers."""
    system = Sawtooth(1.0, 1.0)
    begin = beginning(system, (lambda system: number) if as_function else number, None)
    start = begin.of(system)
    assert isinstance(start[0], jax.Array) and jnp.issubdtype(start[0].dtype, jnp.floating)
    assert state_names(start) == ["x"] and float(start[0]) == 1.0


@pytest.mark.parametrize(
    ("parameters", "bounds", "message"),
    [
        (["stifness"], None, r"must have names among .*'stiffness'.* but has \['stifness'\]. Did you mean 'stiff"),
        ("mass, stiffness", None, r"has \['mass, stiffness'\]. Give a list: \['mass', 'stiffness'\]."),
        (["mass", "mass"], None, "each name once"),
        (["mass"], {"mass": (2.0, 3.0)}, "must lie within its bounds"),
        (["mass"], {"mass": (3.0, 2.0)}, "lo < hi"),
        (["mass"], {"damping": "positive"}, "`bounds` must have names among"),
    ],
)
def test_wrong_names_and_bounds_are_refused(parameters, bounds, message):
    """Assert that misspelt names, repeated names and impossible bounds are named."""
    with pytest.raises(ValueError, match=message):
        select(ElasticStop(), parameters, bounds)


def test_what_the_data_do_not_tell_widens_no_other_interval():
    """Assert that a parameter without effect, and one of two that do the same, take no degree of freedom."""
    x = np.linspace(0.0, 1.0, 6)
    r, line = np.sin(40 * x), np.stack([np.ones(6), x], axis=1)
    of = lambda J: uncertainty("abcd"[: J.shape[1]], np.ones(J.shape[1]), r, J, np.zeros(J.shape[1]), Noise(False))
    plain, wide = of(line), of(np.column_stack([line, 0 * x, 3 * x]))
    assert plain.freedom == wide.freedom == 4 and plain.noise == wide.noise
    assert wide.standard_errors[0] == pytest.approx(plain.standard_errors[0], rel=1e-12)
    assert np.isinf(wide.standard_errors[1:]).all()


def test_uncertainty_of_a_straight_line_is_the_textbook_one():
    """Assert that slope and intercept of a line have SciPy's standard errors, and Student's intervals."""
    x = np.linspace(0.0, 1.0, 20)
    y = 1 + 2 * x + 0.1 * np.random.default_rng(1).normal(size=20)
    line = stats.linregress(x, y)
    residuals = line.intercept + line.slope * x - y
    values, jacobian = np.array([line.intercept, line.slope]), np.stack([np.ones(20), x], axis=1)
    known = uncertainty(("a", "b"), values, residuals, jacobian, np.zeros(2), Noise(sigmas_given=False))
    np.testing.assert_allclose(known.standard_errors, [line.intercept_stderr, line.stderr], rtol=1e-12)
    width = half_width(known.standard_errors, 0.95, known.quantile_freedom)
    np.testing.assert_allclose(width, stats.t.ppf(0.975, 18) * known.standard_errors, rtol=1e-12)


@pytest.mark.parametrize("value", [0.0, 1e-16, -3e-13, 1e-9])
def test_a_value_near_zero_is_known_as_well_as_any(value):
    """Assert that intercept, slope and curvature have the covariance of linear least squares where the slope is near
    0: it was infinite, and the others' too small."""
    x = np.linspace(0.05, 2.0, 40)
    jacobian = np.stack([np.ones(40), x, -(x**2) / 2], axis=1) / 1e-3
    noise = Noise(sigmas_given=True, largest=2e4, scale=np.array([1.2, 0.3, 9.0]))
    known = uncertainty(("a", "b", "c"), [1.0, value, 9.81], np.zeros(40), jacobian, np.zeros(3), noise)
    assert known.unseen == () and known.null_directions == []
    np.testing.assert_allclose(known.covariance, np.linalg.inv(jacobian.T @ jacobian), rtol=1e-9)


def test_a_robust_fit_of_many_normal_residuals_has_nearly_the_plain_errors():
    """Assert that Huber's covariance with a far threshold equals the plain one, and costs a few percent with a near
    one."""
    random = np.random.default_rng(2)
    jacobian, r = random.normal(size=(4000, 2)), random.normal(size=4000)
    errors = lambda robust=np.inf: (
        uncertainty(("a", "b"), [1.0, 1.0], r, jacobian, np.zeros(2), Noise(False, robust)).standard_errors
    )
    np.testing.assert_allclose(errors(1e6), errors(), rtol=1e-9)
    np.testing.assert_allclose(errors(2.0), errors(), rtol=0.1)
    assert np.all(errors(2.0) != errors())


def test_intervals_of_a_robust_fit_of_few_data_hold_the_truth_as_often_as_they_say():
    """Assert that intervals of a parabola through five data hold it in 95 %: it was 81 %, by the quantile of a known
    sigma where the residuals had told it."""
    x, random, held = np.linspace(0.0, 1.0, 5), np.random.default_rng(0), []
    jacobian = np.stack([np.ones(5), x, x**2], axis=1)
    for noise in random.normal(size=(1000, 5)):
        values = np.linalg.lstsq(jacobian, noise, rcond=None)[0]
        known = uncertainty("abc", values, jacobian @ values - noise, jacobian, np.zeros(3), Noise(True, robust=1e6))
        held.append(np.abs(values) < half_width(known.standard_errors, 0.95, known.quantile_freedom))
    np.testing.assert_allclose(np.mean(held, axis=0), 0.95, atol=0.02)


def test_a_direction_without_information_is_named():
    """Assert that parameters that only enter as a product have the null direction (1, -1) / sqrt 2 in relative
    change."""
    a, b = 2.0, 5.0
    jacobian = np.outer(np.linspace(1, 2, 10), [b, a])
    known = uncertainty(("a", "b"), [a, b], np.ones(10), jacobian, np.zeros(2), Noise(sigmas_given=True))
    (direction,) = known.null_directions
    assert abs(direction["a"] + direction["b"]) < 1e-12 and abs(abs(direction["a"]) - 0.5**0.5) < 1e-12
    assert np.all(np.isinf(known.standard_errors))
