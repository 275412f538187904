"""Methods and costs that are written otherwise than they must be: which one, of which class, and what to write."""

from collections.abc import Callable
from typing import Any

import jax
import jax.numpy as jnp
import jaxtyping
import pytest

import hybridsens as hs
from hybridsens.comparison.check_gradient import check_gradient
from hybridsens.estimation import fit
from hybridsens.plot import plot_trajectory
from hybridsens.sweeps import grid, sweep


@pytest.fixture(autouse=True)
def no_checker_of_annotations():
    """A user has none: what a wrong argument is answered with is the package's own word."""
    jaxtyping.config.update("jaxtyping_disable", True)
    yield
    jaxtyping.config.update("jaxtyping_disable", False)


class Ball(hs.AbstractScene):
    weight: jax.Array

    def mass_matrix(self, q):
        return jnp.eye(1)

    def force(self, t, q, v):
        return -self.weight[None]

    def gap(self, t, q):
        return q

    def restitution(self):
        return jnp.array([0.8])


class Energies(hs.LagrangianScene):
    def kinetic_energy(self, q, v):
        return v @ v / 2

    def gap(self, t, q):
        return q

    def restitution(self):
        return jnp.array([0.8])


class Relay(hs.AbstractSwitchedScene):
    mass_matrix, gap, restitution = Ball.mass_matrix, Ball.gap, Ball.restitution

    def force(self, t, q, v, mode):
        return -q

    def switches(self, t, q, v, mode):
        return q - 0.5

    def switch(self, event, t, q, v, mode):
        return v, ~mode


class Falling(hs.AbstractHybridSystem):
    def flow(self, t, x, mode):
        return jnp.stack([x[1], -9.81])

    def guards(self, t, x, mode):
        return x[:1]

    def transition(self, event, t, x, mode):
        return -x, mode


BALL, START, X0 = Ball(jnp.array(9.81)), hs.State([1.0], [0.0]), jnp.array([1.0, 0.0])


def moved(base: type, **methods) -> Any:
    """The motion of a scene or a system with other methods, of the class Odd."""
    odd = type("Odd", (base,), methods)(*([BALL.weight] if base is Ball else []))
    if base is Falling:
        return hs.solve(odd, X0, t1=0.3)
    return hs.simulate(odd, START, *([True] if base is Relay else []), t1=0.3)


METHODS = [
    (Ball, "force", lambda self, q, v: q, r"def force\(self, t, q, v\)`, but is `<lambda>\(self, q, v\)` in Odd"),
    (Ball, "force", lambda t, q: q, r"def force\(self, t, q, v\)`, but is `<lambda>\(t, q\)` in Odd"),
    (Ball, "mass_matrix", lambda self: 1, r"def mass_matrix\(self, q\)`, but is `<lambda>\(self\)` in Odd"),
    (Ball, "gap", lambda self, t, q, v: q, r"def gap\(self, t, q\)`, but is `<lambda>\(self, t, q, v\)` in Odd"),
    (Ball, "restitution", jnp.array([0.8]), r"def restitution\(self\)`, but is an array in Odd"),
    (Ball, "jump_times", lambda self, t: t, r"def jump_times\(self\)`, but is `<lambda>\(self, t\)` in Odd"),
    (Ball, "force", lambda self, t, q, v: None, "`force` must .* that of Odd returns None: is a `return` missing"),
    (Ball, "force", lambda self, t, q, v: (q[0],), r"that of Odd returns tuple: make it an array by jnp.array"),
    (Ball, "force", lambda self, t, q, v: jnp.array([1]), "write 1.0 in place of 1, in it or in a field"),
    (Ball, "force", lambda self, t, q, v: q[0], r"\(1,\), but that of Odd returns shape \(\): put the number into"),
    (Ball, "restitution", lambda self: jnp.ones(2), "It must have an entry for each gap"),
    (Energies, "kinetic_energy", lambda self, v: v @ v, r"def kinetic_energy\(self, q, v\)`, but is .* in Odd"),
    (Energies, "kinetic_energy", lambda self, q, v: None, "`kinetic_energy` must return .* Odd returns None"),
    (Energies, "potential_energy", lambda self, t, q: q[0], r"def potential_energy\(self, q\)`"),
    (Energies, "potential_energy", lambda self, q: None, "`potential_energy` must return .* Odd returns None"),
    (Energies, "dissipation", lambda self, v: v @ v, r"def dissipation\(self, q, v\)`"),
    (Energies, "applied_force", lambda self, t: t, r"def applied_force\(self, t, q, v\)`"),
    (Energies, "applied_force", lambda self, t, q, v: None, "`applied_force` must return .* Odd returns None"),
    (Energies, "applied_force", lambda self, t, q, v: q[0], r"`applied_force` must return an array of shape \(1,\)"),
    (Relay, "force", lambda self, t, q, v: q, r"def force\(self, t, q, v, mode\)`, but is .* in Odd"),
    (Relay, "switches", lambda self, t, q, v: q, r"def switches\(self, t, q, v, mode\)`"),
    (Relay, "switch", lambda self, t, q, v, mode: (v, mode), r"def switch\(self, event, t, q, v, mode\)`"),
    (Falling, "flow", lambda self, t, x: x, r"def flow\(self, t, x, mode\)`, but is `<lambda>\(self, t, x\)` in Odd"),
    (Falling, "flow", lambda self, t, x, mode: (x[1], x[0]), r"of the form f64\[2\], but .*Odd returns \(f64\[\], f64"),
    (Falling, "flow", lambda self, t, x, mode: None, "`flow` must return .* Odd returns None: is a `return` missing"),
    (Falling, "guards", lambda self, x: x, r"def guards\(self, t, x, mode\)`"),
    (Falling, "transition", lambda self, t, x, mode: x, r"def transition\(self, event, t, x, mode\)`"),
    (Falling, "transition", lambda self, event, t, x, mode: x, r"Odd returns f64\[2\]: write `return x, mode`"),
    (Falling, "scheduled_times", lambda self: X0, r"def scheduled_times\(self, x, mode\)`"),
    (Falling, "jump_times", lambda self, t: X0, r"def jump_times\(self\)`"),
]


@pytest.mark.parametrize("base, name, method, message", METHODS)
def test_a_method_that_is_written_otherwise_is_told_how(base, name, method, message):
    """Its name, its class, and what it must take or return."""
    with pytest.raises((TypeError, ValueError), match=message):
        moved(base, **{name: method})


RECORD = {"t": [0.1, 0.2], "q0": [0.9, 0.8]}
BOUNCING, ROOM = hs.scenes.BouncingBall(), hs.systems.Thermostat()
final = lambda ball, simulate: simulate(ball, START, t1=0.3)
CALLS: dict[str, tuple[Callable[[], Any], str]] = {
    "state first": (lambda: hs.simulate(START, BALL, t1=0.3), "the other way round: write simulate"),  # type: ignore
    "a class": (lambda: hs.simulate(Ball, START, t1=0.3), r"is the class Ball itself: make one of it, Ball\(...\)"),  # type: ignore
    "a method": (
        lambda: hs.simulate(BOUNCING, BOUNCING.initial_state, t1=0.3),  # type: ignore
        r"`state` must be .* but is the method initial_state itself: call it, initial_state\(\)\.$",
    ),
    "its x0": (lambda: hs.solve(ROOM, ROOM.initial_state, t1=0.3), r"`x0` must .* call it, initial_state\(\)"),
    "its mode": (lambda: hs.solve(ROOM, 20.0, ROOM.initial_mode, t1=0.3), r"`mode` must .* call it, initial_mode\(\)"),
    "a system": (lambda: hs.simulate(Falling(), START, t1=0.3), "Falling, a hybrid system: use hybridsens.solve"),  # type: ignore
    "a scene": (lambda: hs.solve(BALL, START, t1=0.3), "Ball, a scene: use hybridsens.simulate"),  # type: ignore
    "a time": (lambda: hs.simulate(BALL, START, 1.0, t1=0.3), "`mode` must .* third argument: times are given by name"),
    "coordinates": (lambda: hs.simulate(BALL, hs.State([1.0, 2], [0, 0]), t1=0.3), "dof = 2: .*the state is wrong"),
    "running cost": (
        lambda: hs.simulate(BALL, START, t1=0.3, running_cost=lambda t, q, v: q[0]),
        r"`running_cost` must be a function of \(scene, t, q, v\), but is `<lambda>\(t, q, v\)`",
    ),
    "switched cost": (
        lambda: hs.simulate(Relay(), START, True, t1=0.3, running_cost=lambda scene, t, q, v: q[0]),
        r"`running_cost` must be a function of \(scene, t, q, v, mode\)",
    ),
    "system's cost": (
        lambda: hs.solve(Falling(), X0, t1=0.3, running_cost=lambda system, t, x: x[0]),
        r"`running_cost` must be a function of \(system, t, x, mode\)",
    ),
    "no cost": (lambda: check_gradient(BALL, START), r"`cost` must be a function cost\(scene, simulate\)"),  # type: ignore
    "checked class": (lambda: check_gradient(Ball, final), "is the class Ball itself"),
    "motion": (lambda: check_gradient(BALL, final), "scalar, but returns Trajectory: take a number from it"),
    "nothing": (lambda: check_gradient(BALL, lambda ball, simulate: None), "returns None: is a `return` missing"),
    "design first": (lambda: sweep(grid(BALL, {"weight": [9.0]}), lambda ball: 1.0), "`cost` must .*before the scenes"),  # type: ignore
    "cost of two": (lambda: sweep(final, grid(BALL, {"weight": [9.0]})), r"`cost` must be a function of \(scene\)"),
    "motion swept": (
        lambda: sweep(lambda ball: final(ball, hs.simulate), grid(BALL, {"weight": [9.0]})),
        r"has Trajectory: return \(J, motion\)",
    ),
    "one scene": (lambda: sweep(lambda ball: ball.weight, BALL), "points around one scene are made by grid"),
    "list first": (lambda: grid([9.0], BALL), "`values` must be a mapping of parameters"),  # type: ignore
    "data first": (lambda: fit(RECORD, BALL, state=START), "`scene` must be .* before the data, but is dict"),  # type: ignore
    "observed": (
        lambda: fit(BALL, RECORD, state=START, observe=lambda q: q),
        r"`observe` must be a function of \(scene, t, q, v\), but is `<lambda>\(q\)`",
    ),
    "unobserved": (lambda: fit(BALL, RECORD, state=START, observe=lambda *given: None), "`observe` must .*None"),
    "motion first": (lambda: plot_trajectory(START, BALL), "must be a motion.*is Ball: what moved comes first"),  # type: ignore
}  # fmt: skip


@pytest.mark.parametrize("name", CALLS)
def test_arguments_in_the_place_of_others_are_told(name):
    """Swapped ones, a class in place of its instance, a cost of other arguments, a cost without a value."""
    call, message = CALLS[name]
    with pytest.raises((TypeError, ValueError), match=message):
        call()


def test_an_error_of_the_users_own_goes_on():
    """Also a TypeError: a method that takes its arguments is not told how to."""

    def force(self, t, q, v):
        return len(3)  # type: ignore

    with pytest.raises(TypeError, match="object of type 'int' has no len"):
        moved(Ball, force=force)


class TurnedBall(Ball):
    def force(self, q, v, t):
        return -self.weight[None]


class TurnedSwitch(hs.AbstractHybridSystem):
    rate: jax.Array

    def flow(self, t, mode, x):
        return -self.rate * x

    def guards(self, t, x, mode):
        return x[None] - 0.5

    def transition(self, event, t, x, mode):
        return x, mode


START = hs.State([1.0], [0.0])
TURNED = [
    (lambda: hs.simulate(TurnedBall(9.81), START, t1=1.0), r"force\(self, t, q, v\)`, but is `force\(self, q, v, t\)`"),
    (
        lambda: hs.simulate(Ball(9.81), START, t1=1.0, running_cost=lambda scene, q, v, t: q[0]),
        r"of \(scene, t, q, v\), but is `<lambda>\(scene, q, v, t\)`",
    ),
    (lambda: hs.solve(TurnedSwitch(1.0), 1.0, 0, t1=1.0), r"flow\(self, t, x, mode\)`, but is `flow\(self, t, mode, x"),
]


@pytest.mark.parametrize(("call", "message"), TURNED, ids=["method", "running cost", "system"])
def test_arguments_in_another_order_are_refused(call, message):
    """They would be given by their places: q as t."""
    with pytest.raises(TypeError, match=message + ".*by their places"):
        call()


def test_other_names_in_the_same_places_are_not():
    class Short(Ball):
        def force(self, time, q, qd):
            return -self.weight[None]

    assert hs.simulate(Short(9.81), START, t1=0.2, running_cost=lambda s, time, q, v: q[0]).status.reached_end


class Switch(TurnedSwitch):
    def flow(self, t, x, mode):
        return jnp.where(mode, -self.rate, self.rate) * x


def test_a_mode_that_was_left_out_is_named():
    with pytest.raises(TypeError) as caught:
        hs.solve(Switch(1.0), 1.0, t1=1.0)
    assert any("give the initial mode as the argument `mode`" in note for note in caught.value.__notes__)
