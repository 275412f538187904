"""A flow that jumps where nothing tells of it makes a derivative wrong: who asks for one is told, with the time."""

import warnings

import jax
import jax.numpy as jnp
import pytest

import hybridsens as hs
from tests.closeness import assert_close

C, P = jnp.array(0.9), jnp.array(1.0)


class Line(hs.AbstractHybridSystem):
    """A point that moves at a constant speed past a place p."""

    c: jax.Array
    p: jax.Array

    def flow(self, t, x, mode):
        return self.c + 0 * x

    def guards(self, t, x, mode):
        return jnp.zeros(0)

    def transition(self, event, t, x, mode):
        return x, mode


class Harmless(Line):
    known_discontinuities = True


def rate(cost, kind=Line, **given):
    """d J / d (c, p), and the motion, for a running cost of x - p."""

    def J(c, p):
        running = lambda system, t, x, mode: cost(x - system.p)
        motion = hs.solve(kind(c, p), 0.0, t1=2.0, running_cost=running, max_steps=512, **given)
        return motion.cost, motion

    with warnings.catch_warnings():
        warnings.simplefilter("ignore", hs.DiscontinuityWarning)
        return jax.jit(jax.grad(J, (0, 1), has_aux=True))(C, P)


UNSEEN = {
    "a number that is none": lambda y: jnp.where(jnp.isfinite(jnp.log(y)), 1.0, 0.0),
    "a quotient": lambda y: y / jnp.abs(y),
    "a sign": lambda y: jnp.sign(jnp.maximum(y, 0.0)),
    "steep": lambda y: jnp.tanh(1e10 * y),
}
QUICK = ("a number that is none", "steep")


@pytest.mark.parametrize("name", [pytest.param(n, marks=[pytest.mark.slow] * (n not in QUICK)) for n in UNSEEN])
def test_a_jump_is_told_to_who_asks_for_a_derivative(name):
    """Derivatives by c and p were 0 for 1.23 and -1.11, or twice that, successful and without a warning. The motion by
    itself is right, and successful."""
    _, motion = rate(UNSEEN[name], throw=False)
    assert motion.status == hs.Status.flow_jumps and motion.status.in_doubt and motion.status.reached_end
    assert_close(motion.doubt_time, P / C, 1e-5)
    alone = hs.solve(Line(C, P), 0.0, t1=2.0, running_cost=lambda s, t, x, m: UNSEEN[name](x - s.p), max_steps=512)
    assert alone.status == hs.Status.successful and jnp.isnan(alone.doubt_time)


@pytest.mark.slow
def test_steps_that_are_run_again_are_looked_at_too():
    """The status is that of the motion, whose steps are not kept; the gradient is raised."""
    again = hs.Replay(recompute=True, segment_steps=512)
    with pytest.raises(jax.errors.JaxRuntimeError, match="came out different"):
        jax.block_until_ready(rate(UNSEEN["a quotient"], adjoint=again))
    (by_c, by_p), motion = rate(UNSEEN["a quotient"], Harmless, adjoint=again)
    assert motion.status == hs.Status.successful and jnp.isfinite(by_c) and jnp.isfinite(by_p)
    assert_close(rate(lambda y: (y + 1.0) ** 3, adjoint=again)[0][0], 12 * C**2, 1e-6)


@pytest.mark.slow
def test_what_the_steps_resolve_is_not():
    """A steep but resolved change and a cost that begins with a rate of 0; a kink; nor what is known to do no harm."""
    slopes, motion = rate(lambda y: jnp.tanh(1e4 * y) + (y + 1.0) ** 3)
    assert motion.status == hs.Status.successful
    by_p = lambda p: ((2 * C - p + 1) ** 4 - (1 - p) ** 4) / (4 * C)  # the integral of (c t - p + 1)^3
    assert_close(jnp.stack(slopes), jnp.stack([2 / C**2 + 12 * C**2, -2 / C + jax.grad(by_p)(P)]), 1e-6)
    assert rate(lambda y: jnp.abs(y))[1].status == hs.Status.successful
    assert rate(UNSEEN["a quotient"], Harmless)[1].status == hs.Status.successful


class Puck(hs.AbstractScene):
    """A puck on a table, with dry friction, between two springs: it turns where its velocity is 0."""

    friction: jax.Array

    def mass_matrix(self, q):
        return jnp.eye(2)

    def force(self, t, q, v):
        return -4 * q - self.friction * v / jnp.sqrt(v @ v + 1e-30)

    def gap(self, t, q):
        return (5.0 - q[0])[None]

    def restitution(self):
        return jnp.ones(1)


@pytest.mark.slow
@pytest.mark.parametrize("method", [hs.Replay(), hs.ForwardSensitivities()], ids=["reverse", "forward"])
def test_dry_friction_in_two_dimensions_is_told(method):
    """Both modes agreed on a derivative that was off by half."""
    differentiate = jax.grad if method.reverse_mode else jax.jacfwd
    end = lambda friction: hs.simulate(
        Puck(friction), hs.State([2.0, 0.0], [0.0, 0.0]), t1=2.0, adjoint=method, max_steps=1024, max_events=4
    ).final.q[0]
    with pytest.raises(hs.SimulationError, match=r"in doubt \(flow_jumps\).* That was at t = 1.570"):
        differentiate(end)(jnp.array(0.5))


def test_a_jump_by_the_time_alone_takes_nothing_from_the_derivative_by_the_state():
    def J(c):
        late = lambda system, t, x, mode: jnp.where(t > 1.0, x, 0.0)
        return hs.solve(Line(c, P), 0.0, t1=2.0, running_cost=late, max_steps=512).cost

    with warnings.catch_warnings():
        warnings.simplefilter("ignore", hs.DiscontinuityWarning)
        assert_close(jax.grad(J)(C), 1.5, 1e-6)


class Stepped(hs.AbstractScene):
    """A force that is constant between knots, above a floor far below. A knot that is not declared has a time in its
    place that the motion does not reach."""

    knots: jax.Array
    levels: jax.Array
    declared: jax.Array

    def mass_matrix(self, q):
        return jnp.eye(1)

    def force(self, t, q, v):
        return self.levels[jnp.searchsorted(self.knots, t, side="right")][None]

    def gap(self, t, q):
        return 9.0 + q

    def restitution(self):
        return jnp.ones(1)

    def jump_times(self):
        return jnp.where(self.declared, self.knots, 5.0)


def test_a_jump_in_time_beside_declared_ones_is_told():
    """q(1) by a knot is (level before - level after) (1 - knot). That of a knot that is not declared was 0, in silence,
    since a time that is declared tells the trace that these are."""
    levels = jnp.array([0.0, 0.5, -0.2, 0.7])

    def end(knots, declared):
        scene, state = Stepped(knots, levels, declared), hs.State([1.0], [0.0])
        motion = hs.simulate(scene, state, t1=1.0, max_events=4, max_steps=256, throw=False)
        return motion.final.q[0], motion

    compiled = jax.jit(jax.grad(end, has_aux=True))
    by_knots = lambda *declared: compiled(jnp.array([0.2, 0.3, 0.6]), jnp.array(declared))
    gradient, motion = by_knots(True, True, True)
    assert motion.status == hs.Status.successful
    assert_close(gradient, -jnp.diff(levels) * (1 - jnp.array([0.2, 0.3, 0.6])), 1e-9)
    _, motion = by_knots(True, False, False)
    assert motion.status == hs.Status.flow_jumps
    assert_close(motion.doubt_time, jnp.array(0.3), 1e-5)
