"""Numbers in a scene's fields: those meant as parameters have a derivative, and of the others a warning tells."""

import math
import warnings
from collections.abc import Callable
from decimal import Decimal
from fractions import Fraction

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from jaxtyping import Array, Float, Int

import hybridsens as hs
from hybridsens.sweeps import grid
from tests.closeness import assert_close


class Falling(hs.AbstractScene):
    """A ball that falls by `weight`, in fields of any sort."""

    def mass_matrix(self, q):
        return jnp.eye(1)

    def force(self, t, q, v):
        return -self.weight * jnp.ones(1)

    def gap(self, t, q):
        return q

    def restitution(self):
        return self.e * jnp.ones(1)


class Ball(Falling):
    weight: jax.Array
    e: Float[Array, ""] = 0.8  # type: ignore


class FloatBall(Falling):
    weight: float
    e: float = 0.8


class HalfBall(Falling):
    weight: jax.Array
    e: float = 0.8


class NamedBall(Falling):
    """A number that the force asks about, beside a name and a function."""

    weight: jax.Array
    scale: float = 2.0
    name: str = "ball"
    bent: Callable = jnp.tanh
    e: Float[Array, ""] = 0.8  # type: ignore

    def force(self, t, q, v):
        return -self.weight * (self.scale if self.scale > 1 else 1.0) * jnp.ones(1)


class Tank(hs.AbstractHybridSystem):
    rate: "Array"

    def flow(self, t, x, mode):
        return -self.rate * x

    def guards(self, t, x, mode):
        return x[None] - 0.01

    def transition(self, event, t, x, mode):
        return x, mode


def height(ball):
    return hs.simulate(ball, hs.State([1.0], [0.0]), t1=1.0, max_events=8).final.q[0]


def told(call, *arguments) -> list[str]:
    """Warnings while a call is traced."""
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        eqx.filter_eval_shape(call, *arguments)
    return [str(warning.message) for warning in caught]


NUMBERS = [10, 10.0, np.float32(10), np.int64(10), Fraction(10), Decimal(10)]


@pytest.mark.parametrize("number", NUMBERS, ids=lambda number: type(number).__name__)
def test_a_number_in_the_field_of_an_array_is_a_real_array(number):
    """Of any sort, given or by default, under a declaration of any sort."""
    ball = Ball(number)
    for leaf in (ball.weight, ball.e, Tank(number).rate):
        assert isinstance(leaf, jax.Array) and leaf.dtype == jnp.result_type(float) and not leaf.weak_type


def test_arrays_of_numpy_become_those_of_jax():
    """Where the field is that of an array: they could not be indexed by an event's number. Integers may be indices."""

    class Of(hs.AbstractHybridSystem):
        amount: jax.Array
        place: jax.Array

        def flow(self, t, x, mode):
            return -x

        def guards(self, t, x, mode):
            return jnp.zeros(0)

        def scheduled_times(self, x, mode):
            return jnp.array([0.25, 0.5])

        def transition(self, event, t, x, mode):
            return x + self.amount[event], mode

    system = Of(np.array([1.0, 2.0]), np.array([3]))
    assert isinstance(system.amount, jax.Array) and type(system.place) is np.ndarray
    assert Of(np.ones(2, np.float32), np.array([3])).amount.dtype == jnp.float32
    assert float(hs.solve(system, 0.0, t1=0.5).final) == pytest.approx(2 + np.exp(-0.25), rel=1e-7)


@pytest.mark.slow
def test_arrays_of_numpy_are_parameters():
    """Also outside of jax.jit, as what `jax.device_get` gives."""
    scene, tank = jax.tree.map(np.asarray, (Ball(10), Tank(1)))
    assert type(scene.weight) is np.ndarray and type(tank.rate) is np.ndarray
    assert height(scene) == height(Ball(10))
    assert hs.solve(tank, 1.0, t1=0.2).final == hs.solve(Tank(1), 1.0, t1=0.2).final


@pytest.mark.slow
def test_a_number_has_a_derivative():
    """Where its field is that of an array, in a scene and in a system; it is that of the closed form."""
    fall = lambda g: jnp.sqrt(2 / g)
    exact = lambda g, e: e * g * fall(g) * (1 - fall(g)) - g * (1 - fall(g)) ** 2 / 2
    found = eqx.filter_grad(height)(Ball(10))
    assert_close(jnp.stack([found.weight, found.e]), jnp.stack(jax.grad(exact, (0, 1))(10.0, 0.8)), 1e-7)
    left = eqx.filter_grad(lambda tank: hs.solve(tank, 1.0, t1=0.2).final)(Tank(1))
    assert_close(left.rate, -0.2 * math.exp(-0.2), 1e-7)


def test_what_is_declared_otherwise_stays():
    """Floats, integers, indices, truths, and whatever is an array already."""

    class Odd(Falling):
        length: float
        count: int
        index: Int[Array, ""]
        held: Array
        single: Array

    odd = Odd(1.0, 2, 3, True, jnp.float32(1))  # type: ignore
    assert [type(value) for value in (odd.length, odd.count, odd.index, odd.held)] == [float, int, int, bool]
    assert odd.single.dtype == jnp.float32


@pytest.mark.parametrize(
    "ball",
    [
        pytest.param(HalfBall(jnp.array(9.81)), id="float"),
        pytest.param(Ball(jnp.array(9.81), jnp.array(1)), id="int", marks=pytest.mark.slow),
    ],
)
def test_a_derivative_past_a_number_is_told_of(ball):
    """In reverse and in forward mode, also under `jax.jit`; a value alone asks for nothing."""
    (message,) = set(told(eqx.filter_grad(height), ball))
    assert f"{type(ball).__name__} has Python numbers or integers in e, which no gradient is taken by" in message
    assert told(eqx.filter_grad(eqx.filter_jit(height)), ball) == [message]
    forward = lambda ball: hs.simulate(ball, hs.State([1.0], [0.0]), t1=1.0, adjoint=hs.ForwardSensitivities()).final.q
    moved = lambda weight: forward(eqx.tree_at(lambda ball: ball.weight, ball, weight))
    assert told(lambda: jax.jvp(moved, (ball.weight,), (ball.weight,))) == [message]
    assert told(height, ball) == told(eqx.filter_grad(height), Ball(9.81)) == []


@pytest.mark.slow
def test_a_number_stays_a_number_beside_whatever_else_the_fields_hold():
    """It may be asked about by `if`, in every transformation; only what is a parameter is an array there."""
    ball, exact = NamedBall(jnp.array(2.0)), 1 - 2 * 2.0 * 0.3**2 / 2
    fall = lambda weight: hs.simulate(NamedBall(weight), hs.State([1.0], [0.0]), t1=0.3).final.q[0]
    assert_close(fall(jnp.array(2.0)), exact, 1e-12)
    assert_close(jax.jit(fall)(jnp.array(2.0)), exact, 1e-12)
    assert_close(jax.vmap(fall)(jnp.array([2.0]))[0], exact, 1e-12)
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        assert_close(jax.jit(jax.grad(fall))(jnp.array(2.0)), -(0.3**2), 1e-8)
        assert_close(jax.grad(fall)(2.0), -(0.3**2), 1e-8)
    assert caught and all("numbers or integers in scale, which" in str(each.message) for each in caught)
    assert ball.name == "ball" and ball.scale == 2.0


def test_a_scene_without_any_array_is_told_of_at_once():
    """No trace shows that a derivative by nothing was taken; a study that needs parameters says so."""
    ball = FloatBall(9.81)
    assert "FloatBall has Python numbers or integers in weight, e, which no gradient" in told(lambda: height(ball))[0]
    assert told(jax.grad(lambda ball: height(ball)), ball) == []  # JAX makes arrays of all of them
    with pytest.raises(ValueError, match="'e'. It is a constant: declare its field as jax.Array"):
        grid(ball, {"e": [0.5]})
    with pytest.raises(ValueError, match="Declare its fields as jax.Array"):
        hs.check_gradient(ball, lambda ball, simulate: simulate(ball, hs.State([1.0], [0.0]), t1=1.0).final.q[0])


def test_a_list_of_numbers_is_a_parameter_where_an_array_is_declared(unchecked):
    class Listed(Falling):
        weight: jax.Array
        e: Float[Array, "contact"]
        kept: list[Array]

    ball = Listed([9.81], (0.8,), [1.0])
    assert ball.weight.shape == ball.e.shape == (1,) and ball.kept == [1.0]
    with pytest.raises(TypeError, match="`weight` of Listed is declared as an array and must hold real numb"):
        Listed(["heavy"], 0.8, [])


@pytest.mark.parametrize("value", [None, "1.0"])
def test_text_and_nothing_at_all_are_no_parameters(value):
    class Weighed(Falling):
        weight: Array
        other: Array | None = None

    with pytest.raises(TypeError, match="`weight` of Weighed is declared as an array and must hold real numbers"):
        Weighed(value)
    assert Weighed(1.0).other is None
