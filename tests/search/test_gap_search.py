"""A gap that dips and comes back inside one long step is met, however short the dip."""

import equinox as eqx
import jax
import jax.numpy as jnp
import mpmath
import numpy as np
import pytest
from jax.extend.core import jaxprs_in_params

import hybridsens as hs
from tests.closeness import assert_close

GRAVITY, START, SPEED = 9.81, (-0.5, 0.2), (1.0, 2.5)


class Thrown(hs.AbstractScene):
    """A bead in the plane, thrown over what a subclass puts in its way."""

    p: jax.Array

    def mass_matrix(self, q):
        return jnp.eye(2)

    def force(self, t, q, v):
        return jnp.array([0.0, -GRAVITY])

    def restitution(self):
        return jnp.ones(jax.eval_shape(self.gap, jnp.zeros(()), jnp.zeros(2)).shape)


class Post(Thrown):
    """A post of p = (width, height) at the origin."""

    def gap(self, t, q):
        return (q[1] - self.p[1] * jnp.exp(-((q[0] / self.p[0]) ** 2)))[None]


class TwoPosts(Thrown):
    """Two posts of width p at 0.1 and -0.1, the nearer one second in the list."""

    def gap(self, t, q):
        return q[1] - jnp.exp(-(((q[0] - jnp.array([0.1, -0.1])) / self.p) ** 2))


class Pulse(Thrown):
    """A floor that jumps up for a time of p around t = 0.3, by 2."""

    def gap(self, t, q):
        return (q[1] + 1 - 2 * jnp.exp(-(((t - 0.3) / self.p) ** 2)))[None]


class Table(Thrown):
    """Ground by a table: a roof at the origin, of width and height p."""

    known_discontinuities = True

    def gap(self, t, q):
        roof = jnp.interp(
            q[0], jnp.stack([-self.p[0], 0 * self.p[0], self.p[0]]), jnp.stack([0.0, 1.0, 0.0]), left="extrapolate"
        )
        return (q[1] + 1 - (1 + self.p[1]) * roof)[None]


class Plane(Thrown):
    """Nothing curved: a wall that tilts and moves evenly."""

    def gap(self, t, q):
        return (self.p[0] * q[0] + jnp.cos(self.p[1]) * q[1] + 9 - 0.1 * t)[None]


@eqx.filter_jit
def fly(scene):
    """The motion until just before the bead reaches the ground."""
    return hs.simulate(scene, hs.State(jnp.array(START), jnp.array(SPEED)), t1=0.55, throw=False)


@eqx.filter_jit
def fly_to_post(p):
    """The same with a post, and how the first event's time changes with it."""

    def first(p):
        motion = fly(Post(p))
        return motion.events.time[0], motion

    slope, motion = jax.jacrev(first, has_aux=True)(p)
    return motion, slope


def height(t):
    return START[1] + SPEED[1] * t - GRAVITY * t * t / 2


def meeting(w, h):
    """When the bead meets the post, and its slopes by (w, h), by 40 digits: x = -w sqrt(log(h / y))."""
    with mpmath.workdps(40):
        w, h = mpmath.mpf(float(w)), mpmath.mpf(float(h))
        y = lambda t: START[1] + SPEED[1] * t - mpmath.mpf(GRAVITY) * t * t / 2
        t = mpmath.mpf("0.5")
        for _ in range(200):
            t = mpmath.mpf("0.5") - w * mpmath.sqrt(mpmath.log(h / y(t)))
        x, post = t - mpmath.mpf("0.5"), y(t)  # what is left of the post at the meeting is the height there
        rate = SPEED[1] - mpmath.mpf(GRAVITY) * t + 2 * x / w**2 * post
        by_w, by_h = -2 * x**2 / w**3 * post, -post / h
        return float(t), np.array([float(-by_w / rate), float(-by_h / rate)])


@pytest.mark.parametrize(
    "width, top",
    [pytest.param(1e-1, 2.0, marks=pytest.mark.slow), (1e-3, 2.0), (1e-3, 0.23), (1e-6, 0.23), (1e-9, 2.0)],
)
def test_a_post_of_any_width_is_met_in_free_flight(width, top):
    """At the right time, with the right slopes by the post's width and height; the bead passes the origin at 0.224."""
    motion, slope = fly_to_post(jnp.array([width, top]))
    time, expected = meeting(width, top)
    assert motion.status == hs.Status.successful
    assert_close(motion.events.time[0], time, 1e-14)
    assert_close(slope, expected, 1e-10 if width > 1e-5 else 1e-5)


@pytest.mark.parametrize("width", [1e-1, 1e-6])
def test_a_post_that_ends_just_below_the_path_is_passed(width):
    """No event, and no more steps than a free flight over nothing; 1e-6 above the post is no grazing."""
    lowest = min(height(0.5 + x) - np.exp(-((x / width) ** 2)) * height(0.5) for x in np.linspace(-0.3, 0.1, 4001))
    motion, _ = fly_to_post(jnp.array([width, height(0.5) - 1e-6 + min(lowest, 0)]))
    assert motion.status == hs.Status.successful and motion.events.count == 0
    assert motion.steps.accepted < 10


class AfterAShot(hs.AbstractScene):
    """A mass on a spring that strikes a nearly plastic wall at -1, and swings back to a pin at 0.3."""

    top: jax.Array

    def mass_matrix(self, q):
        return jnp.eye(1)

    def force(self, t, q, v):
        return -q

    def gap(self, t, q):
        return jnp.stack([q[0] + 1, 1 - self.top * jnp.exp(-(((q[0] - 0.3) / 1e-3) ** 2))])

    def restitution(self):
        return jnp.array([1e-3, 1.0])


@pytest.mark.slow
def test_a_pin_is_met_after_a_phase_a_thousand_times_faster():
    """It is higher than the way by 1e-5: nothing beside the doubt of a motion at 1000, much beside that at 1."""
    motion = hs.simulate(AfterAShot(jnp.array(1 + 1e-5)), hs.State([0.0], [-1000.0]), t1=4.0)
    np.testing.assert_array_equal(motion.events.contact[:4], [0, 1, 0, 1])


@pytest.mark.slow
def test_of_two_posts_the_nearer_one_is_met():
    """The second of the list, at x = -0.1, not the first."""
    motion = fly(TwoPosts(jnp.array(1e-4)))
    assert motion.events.contact[0] == 1
    assert_close(motion.events.time[0], 0.4 - 1e-4 * np.sqrt(np.log(1 / height(0.4))), 1e-6)


@pytest.mark.slow
@pytest.mark.parametrize("length", [1e-1, 1e-5])
def test_a_pulse_in_time_is_met(length):
    """2 exp(-((t - 0.3) / p)^2) reaches the bead where it is 1 + y."""
    motion = fly(Pulse(jnp.array(length)))
    time = 0.3
    for _ in range(100):
        time = 0.3 - length * np.sqrt(np.log(2 / (1 + height(time))))
    assert motion.status == hs.Status.successful
    assert_close(motion.events.time[0], time, 1e-12)


@pytest.mark.slow
def test_a_table_is_sampled_inside_the_step():
    """A search in a table has no bounds, which is said; a roof as wide as a sixteenth of the step is found all the
    same."""
    with pytest.warns(UserWarning, match="max_step"):
        motion = fly(Table(jnp.array([0.03, 0.5])))
    assert motion.events.count >= 1
    time = 0.5 - 0.03 * (1 - (1 + height(0.48)) / 1.5)
    assert abs(float(motion.events.time[0]) - time) < 3e-3


def loops(scene):
    """How many loops the program of a motion holds."""
    count = lambda jaxpr: sum(
        (e.primitive.name == "while") + sum(count(inner) for inner in jaxprs_in_params(e.params)) for e in jaxpr.eqns
    )
    return count(jax.make_jaxpr(lambda p: fly(type(scene)(p)).final.q)(scene.p).jaxpr)


def test_gaps_that_are_affine_are_not_searched():
    """The program of a scene with a plane that tilts and moves evenly has two loops less than that of a post."""
    assert loops(Plane(jnp.ones(2))) == loops(Post(jnp.ones(2))) - 2  # where open, and along what is held
