"""torchdiffeq: bouncing by a loop of `odeint_event`, with the right gradient and with the one most users get.

`odeint_event` differentiates the event function by the state only. A parameter that stands in it (P2: the
place of the stop) therefore gets a wrong gradient in silence, unless the parameters are part of the state.
"""

import importlib.util
from functools import partial

import numpy as np

from tests.problems import references

from . import reference

if importlib.util.find_spec("torchdiffeq") is not None and importlib.util.find_spec("torch") is not None:
    import torch
    import torchdiffeq

# A segment must not begin with a gap of zero or less, or the next impact is missed: it begins with this one.
FIRST_GAP = 1e-12


def available() -> str | None:
    """Why this peer cannot run here, or `None` if it can."""
    for package in ("torch", "torchdiffeq"):
        if importlib.util.find_spec(package) is None:
            return f"{package} is not installed (pip install {package})"
    return None


class BouncingBall:
    """P1, parameters q0 v0 g e, motion (q, v, integral of q^2)."""

    horizon = 2.0
    inside = 1.0  # sign of d(gap)/dq

    def start(self, p):
        return torch.stack([p[0], p[1], torch.zeros_like(p[0])])

    def rate(self, t, x, p):
        return torch.stack([x[1], -p[2], x[0] ** 2])

    def gap(self, x, p):
        return x[0]


class ElasticStop:
    """P2 and P2b, parameters omega zeta A Omega d e."""

    horizon = 20.0
    inside = -1.0

    def start(self, p):
        return torch.zeros(3, dtype=p.dtype)

    def rate(self, t, x, p):
        acceleration = -(p[0] ** 2) * x[0] - 2 * p[0] * p[1] * x[1] + p[2] * torch.cos(p[3] * t)
        return torch.stack([x[1], acceleration, x[0] ** 2])

    def gap(self, x, p):
        return p[4] - x[0]


PROBLEMS = {"P1": BouncingBall, "P2": ElasticStop, "P2b": ElasticStop}


def cost(problem: str, parameters, tolerance: float, *, carried: bool = True):
    """Integral of q^2 as a torch scalar; `carried` puts the parameters into the state, else they are closed over."""
    scene = PROBLEMS[problem]()
    settings = {"rtol": tolerance, "atol": tolerance, "method": "dopri5"}
    constant = torch.zeros_like(parameters)

    def split(state):
        return (state[:3], state[3:]) if carried else (state, parameters)

    def field(t, state):
        rate = scene.rate(t, *split(state))
        return torch.cat([rate, constant]) if carried else rate

    def event(t, state):
        """The gap, or the time left where that is less: `odeint_event` has no end of its own."""
        return torch.minimum(scene.gap(*split(state)), scene.horizon - t)

    motion = scene.start(parameters)
    state = torch.cat([motion, parameters]) if carried else motion
    t = torch.zeros((), dtype=parameters.dtype)
    while True:
        t, states = torchdiffeq.odeint_event(field, state, t, event_fn=event, **settings)
        state = states[-1]
        if t > scene.horizon - 10 * tolerance:
            return state[2]
        # The event time is known to the tolerance only: the value, not the derivative, is put right.
        position = state[0] + scene.inside * (FIRST_GAP - scene.gap(*split(state)).detach())
        bounced = torch.stack([position, -parameters[-1] * state[1], state[2]])
        state = torch.cat([bounced, state[3:]])


def value_and_gradient(problem: str, parameters, tolerance: float, *, carried: bool = True):
    """The integral of q^2 and its derivative by every parameter, as numpy."""
    reference.require(available())
    leaf = torch.tensor(np.asarray(parameters), dtype=torch.float64, requires_grad=True)
    value = cost(problem, leaf, tolerance, carried=carried)
    (gradient,) = torch.autograd.grad(value, leaf)
    return value.item(), gradient.numpy()


def main(tolerance: float = 1e-8) -> None:
    """Print errors and times; nothing is compiled."""
    reference.require(available())
    torch.set_num_threads(1)
    reference.print_header()
    for problem in PROBLEMS:
        parameters = references.load(problem).parameters
        for carried, name in ((True, "in the state"), (False, "closed over")):
            both = partial(value_and_gradient, problem, parameters, tolerance, carried=carried)
            forward = partial(cost, problem, torch.tensor(parameters), tolerance, carried=carried)
            found = reference.errors(problem, *both())
            times = [reference.seconds_per_call(call, repeats=3) for call in (forward, both)]
            reference.print_row(f"{problem} torchdiffeq, {name}", found, *times, None)


if __name__ == "__main__":
    main()
