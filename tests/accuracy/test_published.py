"""Published problems that other systems were tried on, against their exact values and derivatives."""

import functools

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import hybridsens as hs
from hybridsens.scenes import BouncingBall, StackedBalls, VibratingTable
from tests.closeness import assert_close
from tests.problems import shipped_motions as motions
from tests.problems.reference_scenes import bouncing_ball
from tests.problems.shipped_motions import solve_with_gradient

TOLERANCE = 1e-10
WITHIN = 1e-7


@functools.cache
def ball(q0, v0, g, e, t1):
    """What is observed of a ball, its Jacobian by (q0, v0, g, e), and the trajectory."""
    return solve_with_gradient(bouncing_ball, (q0, v0, g, e), t1, TOLERANCE)


def impact_times(q0, g, e, count):
    """Closed form for a ball dropped from rest: t_1 = sqrt(2 q0 / g), then flights of 2 e^k t_1."""
    first = np.sqrt(2 * q0 / g)
    return first * (1 + 2 * np.cumsum(np.concatenate([[0.0], e ** np.arange(1, count)])))


@pytest.mark.slow
def test_ball_after_one_bounce():
    """Schaefer's blog: the state after one bounce, and the velocity just before it."""
    seen, jacobian, _ = ball(5.0, -0.1, 10.0, 0.8, 1.9)
    assert_close(seen.time[0], 0.9900499987500625, WITHIN)
    assert_close(seen.final, [3.139918957027149, -1.099100022498875], WITHIN)
    expected = [0.8378281128914257, 0.1015317211209732, -0.1039068435317883, 9.099954976126194]
    assert_close(jacobian.final[0], expected, WITHIN)
    assert_close(jacobian.before[0, 1, :3], [-0.99995000375, 0.0099995000375, -0.49997500187], WITHIN)


@pytest.mark.slow
@pytest.mark.parametrize(
    "e, x, loss, by_e",
    [
        (0.8, 8.49421700760603, 132.383042268, -7238.72161744448),
        (0.866554105436901, 19.3679028154539, 0.399546850711, 0.0),
    ],
)
def test_loss_of_a_fit_and_its_slope(e, x, loss, by_e):
    """SciMLSensitivity's documentation: the loss (x(15) - 20)^2 and its slope, 0 at the published optimum."""
    seen, jacobian, _ = ball(50.0, 0.0, 9.8, e, 15.0)
    miss = seen.final[0] - 20
    assert_close(seen.final[0], x, WITHIN)
    assert_close(miss**2, loss, WITHIN)
    assert_close(2 * miss * jacobian.final[0, 3], by_e, WITHIN, scale=7238.72)


@pytest.mark.slow
def test_tenth_impact_of_a_ball_with_a_radius():
    """torchdiffeq's example: how the tenth impact moves with height, velocity, g, radius (in the gap alone) and e."""

    def scene_of(q0, v0, g, radius, e):
        return BouncingBall(height=q0, velocity=v0, weight=g, floor=radius, restitution_coefficient=e)

    seen, jacobian, _ = solve_with_gradient(scene_of, (10.0, 0.0, 9.8, 0.2, 0.8), 11.5, TOLERANCE)
    assert_close(seen.time[jnp.array([0, 1, 9])], [1.4142135623731, 3.67695526217005, 11.2094218113698], WITHIN)
    expected = [0.5719092760902975, 0.1020408163265306, -0.5719092760902975, -0.5719092760902975, 44.13692374386432]
    assert_close(jacobian.time[9], expected, WITHIN)


def test_seven_impacts():
    """CasADi's bouncing ball: seven impact times, the final state, and the final height's gradient."""
    seen, jacobian, _ = ball(5.0, 0.0, 9.81, 0.8, 7.0)
    times = [1.00963755469, 2.6250576422, 3.91739371221, 4.95126256821, 5.77835765301, 6.44003372086, 6.96937457513]
    assert_close(seen.time[:7], times, WITHIN)
    assert_close(seen.final, [0.05901261515655048, 1.77669809422465], WITHIN)
    expected = [-1.231886142925945, 0.6338882089486519, -37.40810258704018]
    assert_close(jacobian.final[0, jnp.array([0, 2, 3])], expected, WITHIN)


def test_time_and_speed_of_a_fall():
    """Diffrax's documentation: when and how fast a dropped ball hits, and how the time moves with its height."""
    seen, jacobian, _ = ball(10.0, 0.0, 8.0, 0.8, 2.0)
    assert_close(seen.time[0], 1.58113883008419, WITHIN)
    assert_close(seen.closing_speed[0], 12.64911064067352, WITHIN)
    assert_close(jacobian.time[0, 0], 0.07905694150420948, WITHIN)


def test_forty_four_impacts():
    """Siconos's event-driven ball: the last of 44 impacts, and a state that 44 saltations have acted on."""
    seen, jacobian, trajectory = ball(1.0, 0.0, 9.81, 0.9, 8.5)
    times = trajectory.events.time
    assert trajectory.events.count == 44
    assert_close(times[:44], impact_times(1.0, 9.81, 0.9, 44), 1e-12)
    assert_close(times[43], 8.491374025647692, 1e-12)
    # What is left of the height is 6e-6 of the height dropped from, so its digits are counted from there.
    assert_close(seen.final, [5.565551008992671e-6, -0.04166519580981356], 1e-10)
    expected = [0.1770826477427166, -0.01805067096755429, 3.565803287090971]
    assert_close(jacobian.final[0, jnp.array([0, 2, 3])], expected, WITHIN)


def test_plastic_impact():
    """Siconos's resting contact: e = 0 takes all of the velocity, by an impulse m v, and the ball stays."""
    seen, _, trajectory = ball(1.0, 0.0, 9.81, 0.0, 2.0)
    assert trajectory.events.count == 1 and trajectory.events.kind[0] == hs.EventKind.CAPTURE
    assert_close(seen.time[0], 0.4515236409857311, WITHIN)
    assert_close(seen.impulse[0, 0], 4.429446918070021, WITHIN)
    assert_close(seen.final, [0.0, 0.0], 1e-14, scale=1.0)
    assert bool(trajectory.mode[0])


class BallBetweenWalls(hs.AbstractScene):
    """A ball between a floor and a ceiling; p = (g, e)."""

    sustained_contact = False
    p: jax.Array

    def mass_matrix(self, q):
        return jnp.eye(1)

    def force(self, t, q, v):
        return -self.p[:1]

    def gap(self, t, q):
        return jnp.stack([q[0], 1.5 - q[0]])

    def restitution(self):
        return jnp.broadcast_to(self.p[1], (2,))


@pytest.mark.slow
def test_floor_and_ceiling():
    """Siconos's two contacts: impacts in turn with a ceiling and a floor, and the gradient through four of them."""

    def final(inputs):
        x0, v0, g, e, t1 = inputs
        scene, start = BallBetweenWalls(jnp.stack([g, e])), hs.State(x0[None], v0[None])
        trajectory = hs.simulate(scene, start, t1=t1, rtol=TOLERANCE, atol=TOLERANCE, max_events=8, throw=False)
        return trajectory.final.q[0], trajectory

    solve = jax.jit(jax.value_and_grad(final, has_aux=True))
    p = jnp.array([1.0, 10.0, 10.0, 0.8, 1.0])
    (x, trajectory), gradient = solve(p)
    times = [0.051316701949486, 0.22831878005288, 0.46654861601954, 0.74135996574722]
    assert_close(trajectory.events.time[:4], times, WITHIN)
    assert trajectory.events.contact[:4].tolist() == [1, 0, 1, 0]
    assert_close(trajectory.events.before.v[0, 0], 9.486832980505138, WITHIN)
    assert_close([x, trajectory.final.v[0]], [1.0792213493824, 2.8794769338113], WITHIN)
    assert_close(gradient[:4], [0.576673221344, 0.288725527963, -0.000388917290708, 9.95054776918], WITHIN)
    (x, trajectory), _ = solve(p.at[4].set(2.0))
    assert_close(trajectory.events.time[4], 1.834535421015, WITHIN)
    assert_close([x, trajectory.final.v[0]], [0.58663463135697, 2.7180560312217], WITHIN)


def test_event_times_of_the_fmi_ball():
    """FMI's reference ball: event times in closed form, and their derivatives by e, up to the tenth."""
    seen, jacobian, _ = ball(1.0, 0.0, 9.81, 0.7, 3.0)
    assert_close(seen.time, impact_times(1.0, 9.81, 0.7, 10), 1e-12)
    by_e = jax.jacfwd(lambda e: 2 * jnp.sqrt(2 / 9.81) * jnp.cumsum(e ** jnp.arange(1, 10)))(0.7)
    assert_close(jacobian.time[1:, 3], by_e, WITHIN)


def test_value_and_gradient_pass_the_accumulation_point():
    """Infinitely many impacts, then rest: the integral of q^2 in closed form, and its gradient.

    A flight of duration d and height h = g d^2 / 8 contributes (8/15) h^2 d, the first fall half of its own.
    """
    seen, jacobian, trajectory = ball(1.0, 0.0, 9.81, 0.7, 3.0)
    cost = lambda p: 8 / 15 * p[0] ** 2 * jnp.sqrt(2 * p[0] / p[1]) * (1 + 2 * p[2] ** 5 / (1 - p[2] ** 5))
    p = jnp.array([1.0, 9.81, 0.7])
    assert trajectory.events.kind[trajectory.events.count - 1] == hs.EventKind.CAPTURE
    assert_close(trajectory.events.time[trajectory.events.count - 1], 2.558633965585808, 1e-5)
    assert_close(seen.cost, cost(p), 1e-9)
    assert_close(jacobian.cost[jnp.array([0, 2, 3])], jax.grad(cost)(p), 1e-9)


def test_elastic_impact_turns_a_derivative_round():
    """DiffTaichi's time-of-impact example: without gravity and with e = 1, what starts higher ends lower."""
    scene_of = lambda height: BouncingBall(height, -2.0, weight=0.0, floor=0.1, restitution_coefficient=1.0)
    seen, jacobian, _ = solve_with_gradient(scene_of, (0.5,), 0.406, TOLERANCE)
    assert_close(seen.final[0], 0.1 + 2 * (0.406 - 0.2), WITHIN)
    assert_close(jacobian.final[0], [-1.0], WITHIN)


@pytest.mark.slow
def test_equal_elastic_balls_swap_their_motions():
    """Nimble's issue 97: the struck ball continues the striking one's line, so its place depends on that one alone."""
    scene = StackedBalls(1.0, 1.0, 0.0, 0.0, 1.0, 1.7, clearance=0.2, restitution_balls=1.0)
    seen, jacobian, _ = motions.solve(scene, TOLERANCE, 1.0, shift=[0.0, 0.0, 1.0, 0.0])
    assert_close(seen.time[0], 0.5, WITHIN)
    assert_close(seen.final, [1.5, 2.2, 0.0, 1.0], WITHIN)
    assert_close(jacobian.final.shift[1], [1.0, 0.0, 1.0, 0.0], WITHIN)


@pytest.mark.parametrize(
    "above, by_speed", [(1e-2, -0.922515353835), (1e-4, -10.0922527905), (1e-6, -101.834913354), (1e-8, -1019.26606014)]
)
def test_derivative_grows_towards_grazing(above, by_speed):
    """A ceiling reached with v0^2 = 2 g h (1 + d): dt/dv0 = -t / sqrt(v0^2 - 2 g h), the closing speed.

    Seen upside down: a ball falls against gravity to the floor. The speed at the ceiling is a difference of numbers
    1/d times larger, which is what the allowance grows with.
    """
    h, g = 1.0, 9.81
    v0 = np.sqrt(2 * g * h * (1 + above))
    seen, jacobian, _ = ball(h, -v0, -g, 0.5, 0.6)
    assert_close(jacobian.time[0, 1], -by_speed, max(WITHIN, 1e-14 / above))
    assert_close(seen.closing_speed[0], np.sqrt(2 * g * h * above), max(WITHIN, 1e-14 / above))


@pytest.mark.slow
def test_release_from_a_table():
    """A ball thrown by a table A sin(w t): the release is where -A w^2 sin(w t) = -g, and the flight that follows."""
    scene_of = lambda amplitude, frequency: VibratingTable(amplitude=amplitude, frequency=frequency)
    p = (0.02, 10 * np.pi)
    seen, jacobian, trajectory = solve_with_gradient(scene_of, p, 0.17, TOLERANCE)
    assert trajectory.events.kind[0] == hs.EventKind.RELEASE
    assert_close(seen.time[:2], [0.016555791959092, 0.16550786762136], WITHIN)
    assert_close(jacobian.time[0], [-0.911504650523, -0.00168755099167], WITHIN)
    assert_close(seen.closing_speed[1], 1.21013528043, WITHIN)
    assert_close(jacobian.time[1, 0], 4.49643389051, WITHIN)


def test_energy_falls_by_the_square_of_the_restitution():
    """jaxonomy's example: after n impacts the energy is g h0 e^(2n)."""
    seen, _, trajectory = ball(1.0, 0.0, 9.81, 0.8, 2.5)
    energy = seen.final[1] ** 2 / 2 + 9.81 * seen.final[0]
    assert_close(energy, 9.81 * 0.8 ** (2 * trajectory.events.count), WITHIN)
    assert_close(energy, 1.645845, 1e-6)
