"""The table of gradient methods: naive gradients are wrong at any step, ours is right, and no row stops the table."""

import csv
from functools import partial

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import hybridsens as hs
from hybridsens.comparison.baselines import (
    BaselineMotion,
    constant_event_time,
    events_at_root,
    penalty_contact,
    where_reset,
)
from hybridsens.comparison.compare import Reference, compare
from hybridsens.comparison.compare_table import plot_comparison
from hybridsens.comparison.differentiate import central_differences
from hybridsens.comparison.functional import choose_cost
from hybridsens.comparison.gradient_methods import GradientMethod, our_methods
from hybridsens.scenes import BouncingBall
from tests.problems import reference_scenes
from tests.problems.references import RECORDS

P2 = ("P2", reference_scenes.elastic_stop, 20.0, 0, lambda motion: motion.cost)
CASES = {
    "P1": ("P1", reference_scenes.bouncing_ball, 2.0, 0, lambda motion: motion.final.q[0]),
    "P2": P2,
    "P3": ("P3", reference_scenes.cylinder_slide, 2.5, 1, lambda motion: motion.final.q[1]),
    "P4": ("P4", reference_scenes.stacked_balls, 1.5, 0, lambda motion: motion.final.q[1]),
}
"""Name of the record, scene of the parameters, horizon, which functional, and that functional of a motion."""


class Ball(BouncingBall):
    """A ball that is never held: its programs are small."""

    sustained_contact = False


def never_held(q0, v0, g, e):
    """P1 in such a scene."""
    return Ball(height=q0, velocity=v0, weight=g, restitution_coefficient=e)


def squared(scene, t, q, v):
    return q @ q


def table(case, methods):
    """Comparison of these methods on a reference problem, in its own parameters and with its own digits."""
    name, scene_of, t1, index, functional = case
    record = RECORDS[name]

    def cost(p, simulate):
        scene = scene_of(*p)
        return functional(simulate(scene, scene.initial_state(), t1=t1, running_cost=squared))

    reference = Reference(float(record["J"][index]), np.array([float(entry) for entry in record["dJ"][index]]))
    return compare(jnp.array(record["p"]), cost, methods=methods, reference=reference, progress=False)


def reverse(name, simulate):
    return GradientMethod(name, simulate, "reverse")


def test_replay_is_right_to_1e_7_in_the_table_of_the_elastic_stop():
    """At tolerance 1e-8 the row of replay has both errors below 1e-7."""
    row = table(P2, our_methods([hs.Replay()], dict(rtol=1e-8, atol=1e-8, max_events=16, max_steps=1024))).rows[0]
    assert row.failure == "" and row.value_error < 1e-7 and row.gradient_error < 1e-7


@pytest.mark.parametrize(
    "case", [pytest.param(case, id=name, marks=[pytest.mark.slow] * (name == "P4")) for name, case in CASES.items()]
)
def test_where_reset_converges_in_value_but_not_in_gradient(case):
    """Sixteen times smaller steps bring the value five times closer, and leave the gradient as wrong as it was."""
    coarse, fine = table(case, [reverse(f"{n}", partial(where_reset, steps=n)) for n in (2000, 32000)]).rows
    assert fine.value_error < coarse.value_error / 5
    assert fine.gradient_error > 0.02
    assert fine.gradient_error == pytest.approx(coarse.gradient_error, rel=0.2)


@pytest.mark.slow
def test_penalty_gradient_does_not_converge_with_the_step():
    """With the springs as they are, three times smaller steps leave the elastic stop's gradient wrong by 17 percent."""
    coarse, fine = table(P2, [reverse(f"{n}", partial(penalty_contact, steps=n)) for n in (16000, 48000)]).rows
    assert fine.gradient_error == pytest.approx(0.17, abs=0.01)
    assert fine.gradient_error == pytest.approx(coarse.gradient_error, rel=0.2)


@pytest.mark.slow
def test_only_the_root_finder_gives_event_times_a_derivative():
    """On the bouncing ball events at the root are right, and the same motion with constant event times is wrong."""
    chains = (partial(method, max_events=4) for method in (events_at_root, constant_event_time))
    case = ("P1", never_held, *CASES["P1"][2:])
    root, constant = table(case, [reverse(f"{k}", chain) for k, chain in enumerate(chains)]).rows
    assert root.gradient_error < 1e-5
    assert constant.value_error < 1e-5 and constant.gradient_error > 0.3


def test_a_motion_that_is_not_finite_is_a_row_that_says_so():
    """As a chain of solves with too little room for its events returns it: the row has a reason and no numbers."""

    def lost(scene, state, **asked):
        return BaselineMotion(hs.State(state.q * jnp.nan, state.v), None)

    row = table(CASES["P1"], [reverse("lost", lost)]).rows[0]
    assert "not finite" in row.failure and np.isnan(row.gradient_error)


def test_ctrl_c_keeps_finished_rows(tmp_path):
    """An interrupt in the second method leaves the first one's row, in the text, the CSV and the picture."""

    def interrupted(*arguments, **settings):
        raise KeyboardInterrupt

    def failing(*arguments, **settings):
        raise ValueError("no such contact")

    methods = [reverse("failing", failing), reverse("where", partial(where_reset, steps=100))]
    comparison = table(CASES["P1"], [*methods, reverse("stopped", interrupted), *methods])
    assert comparison.interrupted and [row.method for row in comparison.rows] == ["failing", "where"]
    assert "ValueError: no such contact" in str(comparison) and "interrupted" in str(comparison)
    comparison.to_csv(tmp_path / "table.csv")
    with open(tmp_path / "table.csv", newline="") as file:
        written = {line["method"]: line for line in csv.DictReader(file)}
    assert float(written["where"]["d/d value[3]"]) == comparison["where"].gradient[3]
    frame = comparison.to_pandas()
    assert list(frame.index) == ["reference", "failing", "where"] and list(frame) == list(written["where"])[1:]
    assert frame["d/d value[3]"]["where"] == comparison["where"].gradient[3] and np.isnan(frame["value"]["failing"])
    plot_comparison(comparison).savefig(tmp_path / "table.png")


class Turns(hs.AbstractHybridSystem):
    """x' = 1 until x comes to the place, by a guard that jumps there, and -1 from then on."""

    place: jax.Array

    def flow(self, t, x, mode):
        return jnp.where(mode, -1.0, 1.0)

    def guards(self, t, x, mode):
        return jnp.where(mode, 1.0, jnp.where(x < self.place, 2.0, -1.0) - x)[None]

    def transition(self, event, t, x, mode):
        return x, jnp.array(True)


def turned(system, solve):
    return solve(system, 0.0, False, t1=2.0).final


@pytest.mark.filterwarnings("ignore:`guards` must be smooth")
def test_a_reference_whose_gradient_is_not_right_is_not_trusted(tmp_path):
    """J = 2 place - 2, of which the reference's gradient is 0; the table, the CSV file and a study say so."""
    settings = dict(max_events=4, max_steps=64, progress=False)
    comparison = compare(Turns(0.7), turned, methods=[], **settings)
    assert comparison.reference.gradient == pytest.approx([0.0])
    assert "status guard_jumps" in comparison.reference.doubt
    assert "not to be trusted" in str(comparison)
    comparison.to_csv(tmp_path / "table.csv")
    assert "not to be trusted" in (tmp_path / "table.csv").read_text()
    assert "(reference not to be trusted" in str(hs.WorkPrecision((), reference=comparison.reference))


@pytest.mark.slow
def test_a_reference_that_fails_says_that_it_is_the_reference():
    """Its solver is not that of the study, so its status alone would be misunderstood."""
    ball = Ball()
    cost = lambda ball, simulate: simulate(ball, ball.initial_state(), t1=2.0).final.q[0]
    with pytest.raises(hs.SimulationError, match="The reference, by Dopri8 at a tolerance of 1e-13: max_events"):
        compare(ball, cost, methods=[], max_events=1, progress=False)


def test_central_differences_turn_one_sided_at_the_edge():
    """d(x^2)/dx at 1, where the function has values only up to 1: 2 to the order of the step."""
    function = jax.jit(lambda x: (jnp.sum(x**2), jnp.all(x <= 1)))
    _, gradient, _ = central_differences(function, bool)(jnp.array([1.0, 0.5]))
    assert gradient == pytest.approx([2, 1], abs=1e-4)
    assert abs(gradient[1] - 1) < 1e-9


def test_a_cost_must_be_a_scalar_and_must_be_given():
    """A vector cost is a failed reference, a scene without functional a TypeError."""
    with pytest.raises(TypeError, match="must return a real scalar"):
        compare(jnp.ones(2), lambda p, simulate: p, progress=False)
    with pytest.raises(TypeError, match="`cost` must be given"):
        compare(jnp.ones(2), progress=False)


def test_every_study_is_found_in_the_package():
    """Each name that is imported when it is first asked for is there, and no other."""
    for name in hs._STUDIES:
        assert getattr(hs, name).__name__ == name
    with pytest.raises(AttributeError, match="no attribute 'nothing'"):
        hs.nothing  # noqa: B018


def test_a_cost_of_one_argument_is_told_what_it_must_take():
    """Before anything is compiled: `simulate` is what each method puts its own in the place of."""

    def final_height(scene):
        return scene.height

    with pytest.raises(TypeError, match=r"two arguments, cost\(scene, simulate\), .* it is final_height\(scene\)"):
        compare(BouncingBall(), final_height, progress=False)
    with pytest.raises(TypeError, match="The scene comes first and the cost second, but a BouncingBall stands"):
        choose_cost(final_height, BouncingBall())
