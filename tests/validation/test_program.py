"""What a method reads from elsewhere may change between calls: a number that is not given is part of the program."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import hybridsens as hs
from hybridsens.mechanics.wrapped import lift_closures
from hybridsens.scenes import SCENES
from hybridsens.system_checks import lifted
from hybridsens.systems import SYSTEMS
from hybridsens.validation.program import digest, traced

GRAVITY, FACTORS, TABLE = 9.81, {"weight": 1.0}, jnp.array([1.0])


class Falling(hs.AbstractScene):
    """A ball whose weight is named by globals."""

    e: jax.Array

    def mass_matrix(self, q):
        return jnp.eye(1)

    def force(self, t, q, v):
        return -GRAVITY * FACTORS["weight"] * TABLE

    def gap(self, t, q):
        return q

    def restitution(self):
        return self.e[None]


class Draining(hs.AbstractHybridSystem):
    """A tank that is filled when it is empty; the global is the rate."""

    amount: jax.Array

    def flow(self, t, x, mode):
        return -GRAVITY

    def guards(self, t, x, mode):
        return x[None]

    def transition(self, event, t, x, mode):
        return x + self.amount, mode


def _changed(monkeypatch, name, value):
    monkeypatch.setitem(globals(), name, value)


@pytest.mark.parametrize(
    "change",
    [
        ("GRAVITY", 4.0),
        ("FACTORS", {"weight": 4 / 9.81}),
        pytest.param(("TABLE", jnp.array([4 / 9.81])), marks=pytest.mark.slow),
    ],
)
def test_a_scene_that_reads_a_global_is_compiled_by_it(change, monkeypatch):
    """Assert height and slope by the initial height in closed form, before, after, and under a derivative."""
    room = dict(t1=0.3, max_events=4, max_steps=64)
    height = lambda g, h=1.0: h - g * 0.3**2 / 2
    fall = lambda h=1.0: hs.simulate(Falling(0.8), hs.State([h], [0.0]), **room).final.q[0]
    assert fall() == pytest.approx(height(9.81), rel=1e-12)
    _changed(monkeypatch, *change)
    assert fall() == pytest.approx(height(4.0), rel=1e-12)
    assert jax.value_and_grad(fall)(2.0) == (pytest.approx(height(4.0, 2.0), rel=1e-12), pytest.approx(1.0))


@pytest.mark.slow
def test_a_system_and_its_running_cost_are_too(monkeypatch):
    """Assert the level after one event, its integral and the slope by the amount."""
    cost = lambda system, t, x, mode: GRAVITY * x
    room = dict(t1=0.5, running_cost=cost, max_events=4, max_steps=64)

    def end(amount):
        solution = hs.solve(Draining(amount), 1.0, **room)
        return solution.final, solution.cost

    for rate in (9.81, 4.0):
        _changed(monkeypatch, "GRAVITY", rate)
        (level, total), slope = end(5.0), jax.grad(lambda amount: end(amount)[0])(5.0)
        assert level == pytest.approx(1 + 5.0 - rate * 0.5, rel=1e-12) and slope == pytest.approx(1.0)
        assert total == pytest.approx(rate * (0.5 * 1.0 - rate * 0.5**2 / 2 + 5.0 * (0.5 - 1 / rate)), rel=1e-9)


@pytest.mark.parametrize("name", [*SCENES, *SYSTEMS])
def test_the_same_functions_are_the_same_program(name):
    """Assert that a model that was made anew compiles nothing anew."""
    of = {**SCENES, **SYSTEMS}[name]
    named = []
    for model in (of(), of()):
        x, t = model.initial_state(), jnp.array(0.0)
        if name in SCENES:
            named.append(lift_closures(model, type(model).running_cost, t, x)[-1])
        else:
            mode = getattr(model, "initial_mode", lambda: None)()
            named.append(lifted(model, None, t, x, mode)[-1])
    assert named[0] == named[1]


def test_programs_that_differ_in_a_number_a_parameter_or_an_array_differ():
    """Assert it of an exponent, of a number deep inside of a branch, of an array, of an operand's place and of a cast;
    and that functions that are made anew do not."""
    table, keys = np.arange(3.0), jax.random.split(jax.random.key(0), 4)

    def functions(k):
        yield lambda x, y: x**k
        yield lambda x, y: jax.lax.cond(x > 0, lambda: x + 0.5 * k, lambda: y)
        yield lambda x, y: x * jnp.array([1.0, k])
        yield lambda x, y: (x - y) if k == 2 else (y - x)
        yield lambda x, y: jnp.array([1.0, 2.0]).at[jnp.int32(x)].get(mode="clip" if k == 2 else "fill")
        yield lambda x, y: (table * k)[1] + x
        yield lambda x, y: x + jax.random.uniform(keys[k])
        yield lambda x, y: jax.nn.relu(x) * jax.vmap(lambda z: z + k)(jnp.ones(2))

    named = lambda k: [digest([traced(f, (jnp.array(1.0), jnp.array(2.0)))]) for f in functions(k)]
    one, other = named(2), named(3)
    assert named(2) == one and len({*one, *other}) == 16
