"""Trivial motions to be differentiated: points, what is looked at, and how well it must be known."""

import functools

import jax
import jax.numpy as jnp
import numpy as np

import hybridsens as hs
from tests.problems import trivial_motions as motions

BARS = {1e-5: 1e-4, 1e-8: 1e-6, 1e-12: 1e-9}
"""Error of a gradient, relative to its largest entry, that is allowed at a tolerance,"""
LOOSER = {
    # Errors of single steps add up over 100 s, and the truth's matrix exponential is known to 2.4e-8 only.
    "undamped for long": 30,
    "drive in free flight": 100,  # (1 - cos 200) / 1600: what is gathered is 1e4 times as large as the sum
    "after three impacts": 2,
}
"""how many times more of it,"""
OWN = {
    "ContinuousCostate": 10,  # its tolerances are its own, absolute ones, for each step
    ("slow beside a fast one at rest", "ContinuousCostate"): 20,  # 32 oscillations, psi of 20
    ("drive in free flight", "ContinuousCostate"): 4,
}
"""and again how many times more for a method."""

TRUTHS = {
    motions.springs: motions.springs_truth,
    motions.springs_sampled: motions.springs_sampled_truth,
    motions.ball: motions.ball_truth,
    motions.held: motions.held_truth,
    motions.driven: motions.driven_truth,
}


def springs_at(t1, **given):
    p = dict(k=[1, 1], c=[0, 0], g=[0, 0], a=[0, 0], w=3, q=[0, 0], v=[0, 0], t1=t1)
    return p | dict(by_q=[1, 0], by_v=[0, 0], by_integral=0) | given


def ball_at(t1, **given):
    p = dict(a=0, w=20, g=9.81, e=0.8, floor=0, q=10, v=0, t1=t1)
    return p | dict(by_q=1, by_v=0, by_integral=0, by_time=0) | given


def held_at(**given):
    p = dict(k=4, a=0, w=3, push=9.81, wall=0, q=0, v=0, t1=10)
    return p | dict(by_q=[1, 0], by_integral=0) | given


_RANDOM = np.random.default_rng(1)
_NETWORK = dict(first=_RANDOM.normal(size=(8, 2)), bias=_RANDOM.normal(size=8), last=np.zeros(8))


def driven_at(**given):
    return _NETWORK | dict(pulses=np.zeros(50), q=0.3, v=0, t1=10) | given


STOP = dict(c=[0.1, 0.1], w=1.3)
"""The oscillator of `ElasticStop`."""

CASES = [
    # name, cost, point, by what it is differentiated
    ("oscillator at rest", motions.springs, springs_at(20, **STOP), "q v"),
    ("its drive, at 0", motions.springs, springs_at(20, **STOP), "a"),
    ("its speed", motions.springs, springs_at(20, **STOP, by_q=[0, 0], by_v=[1, 0]), "q v a"),
    ("undamped for long", motions.springs, springs_at(100), "q v a"),
    ("forced, a = 0", motions.springs, springs_at(10), "a"),
    ("forced, a = 1e-8", motions.springs, springs_at(10, a=[1e-8, 0]), "a"),
    ("forced, a = 1e-6", motions.springs, springs_at(10, a=[1e-6, 0]), "a"),
    ("forced, a = 1e-3", motions.springs, springs_at(10, a=[1e-3, 0]), "a"),
    ("free flight", motions.springs, springs_at(5, k=[0, 0], g=[9.81, 1], v=[3, 2]), "q v g a k c t1"),
    ("drive in free flight", motions.springs, springs_at(5, k=[0, 0], g=[9.81, 0], w=40), "a"),
    ("slow beside a fast one at rest", motions.springs, springs_at(10, k=[0.01, 400], q=[1, 0], by_q=[1, 1]), "q v"),
    ("the fast one's drive", motions.springs, springs_at(10, k=[0.01, 400], q=[1, 0], by_q=[1, 1]), "a"),
    ("running cost at rest", motions.springs, springs_at(20, **STOP, by_q=[0, 0], by_integral=1), "q v a"),
    ("running cost, flying", motions.springs, springs_at(5, k=[0, 0], by_q=[0, 0], v=[1, 0], by_integral=1), "q a k"),
    ("overdamped at rest", motions.springs, springs_at(20, c=[30, 1]), "q v a"),
    ("data at rest", motions.springs_sampled, springs_at(20, **STOP), "q v"),
    ("data of a drive at 0", motions.springs_sampled, springs_at(20, **STOP), "a"),
    ("data in free flight", motions.springs_sampled, springs_at(20, k=[0, 0], g=[9.81, 0], v=[50, 0]), "q v a k"),
    ("ball in flight, a = 0", motions.ball, ball_at(1.2), "a"),
    ("ball in flight, a = 1e-6", motions.ball, ball_at(1.2, a=1e-6), "a"),
    ("ball in flight, a = 1e-3", motions.ball, ball_at(1.2, a=1e-3), "a"),
    ("ball in flight, a = 1", motions.ball, ball_at(1.2, a=1.0), "a w"),
    ("after one impact", motions.ball, ball_at(3.0), "a e g q v floor t1"),
    ("after three impacts", motions.ball, ball_at(6.0), "a e g q v floor t1"),
    ("speed after two impacts", motions.ball, ball_at(4.0, by_q=0, by_v=1), "a e g"),
    ("after two impacts, a = 1e-6", motions.ball, ball_at(4.0, a=1e-6), "a e g"),
    ("running cost over impacts", motions.ball, ball_at(4.0, by_q=0, by_integral=1), "a e floor"),
    ("times of impacts", motions.ball, ball_at(4.0, by_q=0, by_time=1), "a e g q v floor"),
    ("beside a held body", motions.held, held_at(), "q v"),
    ("drive beside a held body", motions.held, held_at(), "a"),
    ("the wall of a held body", motions.held, held_at(by_q=[0, 1], by_integral=1), "wall q v a"),
    ("last layer 0, at rest", motions.driven, driven_at(), "last"),
    ("last layer 0, moving", motions.driven, driven_at(v=0.5), "last q v"),
    ("fifty pulses of 0", motions.driven, driven_at(), "pulses"),
    ("fifty pulses of 0, moving", motions.driven, driven_at(v=-2.0), "pulses"),
]

REPLAY, FORWARD = "Replay", "ForwardSensitivities"
ADJOINTS = {
    REPLAY: lambda tolerance: hs.Replay(),
    "Replay(recompute=True)": lambda tolerance: hs.Replay(recompute=True),
    FORWARD: lambda tolerance: hs.ForwardSensitivities(),
    "ContinuousCostate": lambda tolerance: hs.ContinuousCostate(tolerance, tolerance),
    "DiffraxAdjoint": lambda tolerance: hs.DiffraxAdjoint(),
}


NOT_REACHED = {
    # A direction is resolved relative to itself, while a pulse is still 1e-100 as well: more than MAX_STEPS steps.
    (motions.driven, FORWARD): (1e-12,),
    ("undamped for long", "ContinuousCostate"): (1e-12,),
}
"""Tolerances at which there are not enough steps, and the gradient is nan."""


@functools.cache
def gradient_of(cost, method, own=None):
    """(point, tolerance) -> gradient by everything; compiled once for all points. `own`: the adjoint's tolerance."""
    derivative = jax.jacfwd if method == FORWARD else jax.grad
    return jax.jit(derivative(lambda p, tolerance: cost(p, tolerance, ADJOINTS[method](own))))


@functools.cache
def true_gradient_of(cost):
    """The closed form's."""
    return jax.jit(jax.grad(TRUTHS[cost]))


def point_of(given):
    """All of a point as arrays."""
    return {name: jnp.asarray(value, float) for name, value in given.items()}


def errors(case, method, tolerance):
    """Errors of the gradient by each of what is looked at, relative to its largest entry."""
    _, cost, given, by = case
    point = point_of(given)
    own = tolerance if method == "ContinuousCostate" else None
    found, truth = gradient_of(cost, method, own)(point, jnp.asarray(tolerance)), true_gradient_of(cost)(point)
    worst = lambda x: float(jnp.max(jnp.abs(x)))
    return {name: worst(found[name] - truth[name]) / worst(truth[name]) for name in by.split() if worst(truth[name])}


def assert_right(case, method):
    """All errors of a case within their bounds, at every tolerance."""
    looser = LOOSER.get(case[0], 1) * OWN.get(method, 1) * OWN.get((case[0], method), 1)
    for tolerance, bar in BARS.items():
        if tolerance in NOT_REACHED.get((case[1], method), NOT_REACHED.get((case[0], method), ())):
            continue
        bar, found = bar * looser, errors(case, method, tolerance)
        assert found and all(error <= bar for error in found.values()), (method, tolerance, found)
