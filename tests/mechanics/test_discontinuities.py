"""Kinks and jumps that a trace shows are told of, and nothing else is."""

import warnings

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from jax import lax

import hybridsens as hs
from hybridsens.interval.breaks import breaks
from hybridsens.scenes import (
    BouncingBall,
    CylinderSlide,
    DoublePendulumWall,
    ElasticStop,
    PendulumWall,
    StackedBalls,
    VibratingTable,
)

TABLE = jnp.array([0.0, 1.0, 3.0])
A = jnp.array([2.0, 1.0])


def found(function):
    """Pairs (operation, inputs) of a function of (t, q, v)."""
    trace = jax.make_jaxpr(function)(0.3, jnp.ones(2), jnp.ones(2))
    return {(b.operation, "".join(sorted(b.inputs)), b.jump) for b in breaks(trace, ("t", "q", "v"))}


BROKEN = {
    "where of t": (lambda t, q, v: jnp.where(t < 1, q, -q), ("jnp.where", "t", True)),
    "where of q and v": (lambda t, q, v: jnp.where(q[0] < v[1], t, -t), ("jnp.where", "qv", True)),
    "maximum": (lambda t, q, v: jnp.maximum(q[0], q[1]), ("jnp.maximum", "q", False)),
    "minimum": (lambda t, q, v: jnp.minimum(q[0], t), ("jnp.minimum", "qt", False)),
    "min of all": (lambda t, q, v: jnp.min(q), ("jnp.min", "q", False)),
    "abs": (lambda t, q, v: jnp.abs(v) + q, ("jnp.abs", "v", False)),
    "sign": (lambda t, q, v: jnp.sign(v), ("jnp.sign", "v", True)),
    "floor": (lambda t, q, v: jnp.floor(t), ("jnp.floor", "t", True)),
    "round": (lambda t, q, v: jnp.round(q), ("jnp.round", "q", True)),
    "remainder": (lambda t, q, v: t % 1.0, ("%", "t", True)),
    "clip": (lambda t, q, v: jnp.clip(q, 0, 1), ("jnp.clip", "q", False)),
    "relu": (lambda t, q, v: jax.nn.relu(q), ("relu", "q", False)),
    "interp": (lambda t, q, v: jnp.interp(q[0], TABLE, TABLE), ("jnp.interp", "q", False)),
    "index": (lambda t, q, v: TABLE[q[0].astype(int)], ("an index that moves", "q", True)),
    "comparison": (lambda t, q, v: (t > 1) * q, ("a comparison or an integer used as a number", "t", True)),
    "cond": (lambda t, q, v: lax.cond(q[0] > 0, jnp.sin, jnp.cos, v), ("lax.cond", "q", True)),
    "switch": (lambda t, q, v: lax.switch(t.astype(int), [jnp.sin, jnp.cos], v), ("lax.cond", "t", True)),
    "in a loop": (
        lambda t, q, v: lax.fori_loop(0, 3, lambda k, x: jnp.maximum(x, q), v),
        ("jnp.maximum", "qv", False),
    ),
    "in a branch": (lambda t, q, v: lax.cond(A[0] > 0, jnp.abs, jnp.cos, v), ("jnp.abs", "v", False)),
    "in jit": (lambda t, q, v: jax.jit(jnp.abs)(v), ("jnp.abs", "v", False)),
    "saturated": (lambda t, q, v: (jnp.where(jnp.clip(q[0], 0, t) == q[0], q, -q)), ("jnp.where", "qt", True)),
    "number of a floor": (lambda t, q, v: jnp.where(jnp.floor(t) % 2 == 0, q, v), ("jnp.where", "t", True)),
    "held fixed": (lambda t, q, v: lax.stop_gradient(jnp.floor(t)) * q, ("jnp.floor", "t", True)),
    "angle": (lambda t, q, v: jnp.arctan2(q[0], v[0]), ("jnp.arctan2", "qv", True)),
    "norm of one number": (lambda t, q, v: v[:1] / jnp.linalg.norm(v[:1]), ("the root of a square", "v", False)),
    "the largest two": (lambda t, q, v: lax.top_k(q, 2)[0], ("lax.top_k", "q", False)),
    "the largest at a place": (lambda t, q, v: TABLE.at[0].max(q[0]), (".at[].max", "q", False)),
    "sorted by others": (lambda t, q, v: lax.sort((q, v))[1], ("what is sorted by other numbers", "qv", True)),
    "in checkpoint": (lambda t, q, v: jax.checkpoint(jnp.abs)(v), ("jnp.abs", "v", False)),
}

SMOOTH = {
    "of parameters": lambda t, q, v: jnp.where(A > 0, q, v) + jnp.abs(A) * jnp.maximum(A, 0) * TABLE[A.astype(int)],
    "quadratic drag": lambda t, q, v: -0.3 * v * jnp.abs(v) + 2.0 * jnp.abs(v[0]) * v[0],
    "penalty": lambda t, q, v: jnp.maximum(-q, 0) ** 2 + jnp.maximum(q[0], 0.0) ** 1.5 + jnp.abs(q) ** 3,
    "smooth minimum": lambda t, q, v: jax.nn.logsumexp(-q) + jnp.logaddexp(t, v) + jax.nn.softplus(q),
    "networks": lambda t, q, v: jax.nn.softmax(q) + jax.nn.silu(v) + jax.nn.gelu(q) + jnp.tanh(v),
    "linear algebra": lambda t, q, v: (
        jnp.linalg.solve(jnp.diag(q), v) + jax.scipy.linalg.solve(jnp.diag(q), v, assume_a="pos") + jnp.linalg.norm(q)
        + jnp.linalg.det(jnp.diag(q)) + jnp.linalg.inv(jnp.diag(q)) @ v + jnp.hypot(q[0], q[1]) + jnp.abs(q @ q)
    ),
    "guards of single points": lambda t, q, v: jnp.where(q == 0, 1, q) + jnp.sinc(v) + jnp.where(jnp.isnan(q), 0, q),
    "angle on the right": lambda t, q, v: jnp.arctan2(q[0], jnp.exp(v[0])) + jnp.sqrt(v**2) * v,
    "size that is 0": lambda t, q, v: jnp.where((r := q @ q) == 0, 1, r) + jnp.linalg.norm(v),
    "not used": lambda t, q, v: (jnp.sign(q), v)[1],
    "steady loop": lambda t, q, v: lax.while_loop(lambda x: jnp.max(x) > 1e-8, lambda x: x / (2 + q**2), v),
    "shapes": lambda t, q, v: jnp.zeros(4).at[1].set(q[0])[::2] + jnp.roll(q, 1) + jnp.tril(jnp.outer(q, v)) @ q,
}  # fmt: skip


@pytest.mark.parametrize("case", BROKEN)
def test_a_break_is_told_with_what_it_depends_on(case):
    """The operation as the user writes it, the inputs that move its place, and whether it may jump."""
    function, expected = BROKEN[case]
    assert found(function) == {expected}


@pytest.mark.parametrize("case", SMOOTH)
def test_what_is_smooth_or_does_not_move_is_not_told(case):
    """Parameters alone move nothing in time, and JAX's own smooth functions select inside."""
    assert found(SMOOTH[case]) == set()


class Ball(hs.AbstractScene):
    """A ball above a floor, with a wind that turns at t = 0.5."""

    p: jax.Array

    def mass_matrix(self, q):
        return jnp.eye(1)

    def force(self, t, q, v):
        return -self.p[0] + jnp.where(t < 0.5, self.p[1:2], -self.p[1:2])

    def gap(self, t, q):
        return q

    def restitution(self):
        return self.p[2:3]


class Terrain(Ball):
    """Ground by a minimum of two, and a smooth force."""

    def force(self, t, q, v):
        return -self.p[0:1] - jnp.maximum(self.p[1], 0) * v

    def gap(self, t, q):
        return jnp.minimum(q, q + 0.1 * jnp.sin(t))


class Smooth(Terrain):
    """Nothing to tell."""

    def gap(self, t, q):
        return q


class Known(Ball):
    """The same ball, by someone who knows."""

    known_discontinuities = True


P = jnp.array([10.0, 1.0, 0.5])


def simulate(scene, **settings):
    return hs.simulate(scene, hs.State([1.0], [0.0]), t1=0.4, **settings)


def test_one_warning_names_function_operation_input_and_remedy():
    """When the motion is compiled, not at every call."""
    with pytest.warns(hs.DiscontinuityWarning) as told:
        simulate(Ball(P))
        simulate(Ball(2 * P))
    assert len(told) == 1
    text = str(told[0].message)
    for part in ("`force`", "jnp.where of t", "jump_ts", "known_discontinuities"):
        assert part in text
    assert "`gap`" not in text


@pytest.mark.slow
def test_a_gap_is_told_to_be_written_as_two():
    """And the force, whose maximum is one of parameters, is not mentioned."""
    with pytest.warns(hs.DiscontinuityWarning, match="`gap` must be smooth.*jnp.minimum of t and q.*one gap for each"):
        simulate(Terrain(P))


def test_a_jump_of_the_running_cost_is_told_and_a_kink_is_not():
    """The gradient of an integral of |q| is right; that of an integral of a jump lacks the shift of its instant."""
    jump, kink = (lambda s, t, q, v: (q[0] > 0.5) * 1.0), (lambda s, t, q, v: jnp.abs(q[0]))
    with pytest.warns(hs.DiscontinuityWarning, match="`running_cost`"):
        simulate(Smooth(P), running_cost=jump)
    simulate(Smooth(P), running_cost=kink)


@pytest.mark.slow
def test_the_warning_can_be_silenced():
    """By the scene, or by Python's filter; warnings are errors in this suite."""
    simulate(Known(P))
    with warnings.catch_warnings():
        warnings.filterwarnings("ignore", category=hs.DiscontinuityWarning)
        simulate(Ball(P), rtol=1e-7)


def test_declared_times_silence_what_depends_on_time_alone():
    """Not what depends on the state as well."""
    from hybridsens.mechanics.smoothness import warn_of_discontinuities

    t, q = jnp.array(0.0), jnp.ones(1)
    warn_of_discontinuities(Ball(P), t, q, q, times_declared=True)
    with pytest.warns(hs.DiscontinuityWarning, match="`gap`"):
        warn_of_discontinuities(Terrain(P), t, q, q, times_declared=True)


SHIPPED = [BouncingBall, CylinderSlide, DoublePendulumWall, ElasticStop, PendulumWall, StackedBalls, VibratingTable]


@pytest.mark.parametrize("scene_class", SHIPPED)
def test_shipped_scenes_are_smooth(scene_class):
    """Ready-made scenes have no break, nor have their running costs."""
    from hybridsens.mechanics.smoothness import scene_breaks

    scene, start = scene_class(), scene_class().initial_state()
    told = scene_breaks(scene, jnp.array(0.0), start.q, start.v, scene_class.running_cost)
    assert not np.any([len(those) for those in told.values()])
