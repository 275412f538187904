"""A scene pays only for what it has: what the compiled programs hold, and what they do not."""

import diffrax
import jax
import jax.numpy as jnp
from jax.extend.core import jaxprs_in_params

import hybridsens as hs
from tests.closeness import assert_close

CONTACTS, DOF, MAX_STEPS = 5, 3, 123


class Beads(hs.AbstractScene):
    """Three bodies over five floors."""

    p: jax.Array

    def mass_matrix(self, q):
        return jnp.diag(1 + self.p**2)

    def force(self, t, q, v):
        return -9.81 * jnp.ones(DOF) - self.p * v

    def gap(self, t, q):
        return jnp.arange(1.0, CONTACTS + 1) * q[0] + q[1] * q[2]

    def restitution(self):
        return jnp.full(CONTACTS, 0.5)


class Bouncing(Beads):
    """The same, declared never to stay closed."""

    sustained_contact = False


class Free(Beads):
    """The same without floors."""

    def gap(self, t, q):
        return jnp.zeros(0)

    def restitution(self):
        return jnp.zeros(0)


P = jnp.array([0.1, 0.2, 0.3])
START = hs.State(jnp.ones(DOF), jnp.zeros(DOF))


def program(scene_class):
    """The traced program of a motion."""
    run = lambda p: hs.simulate(scene_class(p), START, t1=1.0, max_steps=MAX_STEPS, max_events=9, throw=False).final
    return jax.make_jaxpr(run)(P).jaxpr


def equations(jaxpr):
    """Every equation of a program, those of its inner programs included."""
    for equation in jaxpr.eqns:
        yield equation
        for inner in jaxprs_in_params(equation.params):
            yield from equations(inner)


def step_loop(jaxpr):
    """The loop over steps: the innermost one that carries the record of steps."""
    carries_record = lambda loop: any(v.aval.shape[:1] == (MAX_STEPS + 2,) for v in loop.outvars)
    return [e for e in equations(jaxpr) if e.primitive.name == "while" and carries_record(e)][-1]


def shapes(jaxpr):
    """Shapes of all floating numbers that a program computes."""
    computed = (variable.aval for equation in equations(jaxpr) for variable in equation.outvars)
    return {aval.shape for aval in computed if jnp.issubdtype(aval.dtype, jnp.floating)}


def body(loop):
    return loop.params["body_jaxpr"].jaxpr


def test_steps_solve_for_no_multiplier_where_no_event_repeats():
    """The multipliers' matrix, (contact, contact), is met in the step loop only if contacts may stay closed.

    Without it there is no release guard either, since that is a multiplier.
    """
    delassus = (CONTACTS, CONTACTS)
    assert delassus in shapes(body(step_loop(program(Beads))))
    assert delassus not in shapes(body(step_loop(program(Bouncing))))


def test_branches_are_paid_for_by_sustained_contact_alone():
    """Choosing by the mode whether to solve for multipliers is met only where contacts may stay closed."""
    branches = lambda cls: sum(e.primitive.name in ("cond", "while") for e in equations(body(step_loop(program(cls)))))
    assert branches(Bouncing) < branches(Beads)
    assert branches(Free) < branches(Beads)


def test_a_free_motion_is_one_plain_solve():
    """As many steps as `diffrax.diffeqsolve` takes with the same error control or one more, and the same end."""
    trajectory = hs.simulate(Free(P), START, t1=3.0, rtol=1e-9, atol=1e-9)

    def flow(t, y, p):
        scene, (q, v) = Free(p), jnp.split(y, 2)
        return jnp.concatenate([v, scene.force(t, q, v) / jnp.diag(scene.mass_matrix(q))])

    plain = diffrax.diffeqsolve(
        diffrax.ODETerm(flow), diffrax.Tsit5(), 0.0, 3.0, None, jnp.concatenate([START.q, START.v]), P,
        stepsize_controller=diffrax.PIDController(rtol=1e-9, atol=1e-9),
    )  # fmt: skip
    assert trajectory.steps.accepted <= plain.stats["num_accepted_steps"] + 1
    assert trajectory.steps.rejected <= plain.stats["num_rejected_steps"]
    assert trajectory.events.count == 0
    assert_close(jnp.concatenate([trajectory.final.q, trajectory.final.v]), plain.ys[0], 1e-8)
