"""The functional whose gradient is studied, as a function of one vector, with what its motions report."""

import contextlib
import inspect
from collections.abc import Callable, Iterator, Mapping
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int

from ..mechanics.switches import has_switches
from ..mechanics.trajectory import Trajectory
from ..outcome import SimulationError
from ..parameters import FlatParameters
from ..settings import Settings
from ..simulate import simulate
from ..solution import Solution
from ..solve import solve
from ..status import Status
from ..system import AbstractHybridSystem
from ..validation.asked import kind_of
from ..validation.direction import FORWARD_ONLY, REVERSE_ONLY

Cost = Callable[..., Any]
"""cost(scene, simulate) -> scalar, or cost(system, solve). The second argument stands for `hybridsens.simulate` or
`hybridsens.solve` with the settings of the method under study bound: the cost passes it the scene, the state, the
horizon and what it wants back, but no settings."""


NEEDED = ("initial_state", "t1", "running_cost")
"""What a scene or a system has where no cost is given: where it starts, how long it runs, what it costs."""


_OWN_MOTION = (
    "`cost` must move its scene by the function that it is given, cost(scene, simulate), in whose place each method "
    "puts its own, but it does not call that one: use it in place of hybridsens.simulate and hybridsens.solve."
)


class CallReport(NamedTuple):
    """What is kept of each call of `simulate` beside the cost."""

    status: tuple[Status, ...]
    count: tuple[Int[Array, ""], ...]
    """Number of events."""
    doubt_time: tuple[Float[Array, ""], ...]
    """When its derivatives came into doubt; nan where they are not."""


def move(model: Any, *start: Any, **settings: Any) -> Trajectory | Solution:
    """`hybridsens.solve` of a hybrid system, `hybridsens.simulate` of anything else; see there."""
    of: Callable = solve if isinstance(model, AbstractHybridSystem) else simulate
    return of(model, *start, **settings)


def running_cost_functional(scene, simulate):
    """J = int running_cost dt over the horizon of a ready-made scene or system: the cost where none is given."""
    return ready_made_motion(scene, simulate).cost


def ready_made_motion(scene: Any, simulate, **settings):
    """The motion of a ready-made scene or system, with its running cost; `settings` replace its own."""
    start = (scene.initial_state(), *_mode(scene))
    settings.setdefault("running_cost", _own_running_cost)
    if "t1" not in settings:
        settings["t1"] = scene.t1
    return simulate(scene, *start, **settings)


def _own_running_cost(scene: Any, *instant):
    """The running cost that a scene or a system has as a method; one of a scene with switches may leave out the mode,
    the last of (t, q, v, mode)."""
    method = scene.running_cost
    if has_switches(scene):
        try:
            inspect.signature(method).bind(*instant)
        except TypeError:
            instant = instant[:-1]
    return method(*instant)


def _mode(scene: Any) -> tuple:
    """The mode in which it starts, where it has modes: None where it does not say which."""
    if not (isinstance(scene, AbstractHybridSystem) or has_switches(scene)):
        return ()
    return (getattr(scene, "initial_mode", lambda: None)(),)


def choose_cost(scene, cost: Any) -> Cost:
    """The cost given, or that of a scene that has all that is `NEEDED`. Raises: TypeError where there is neither, or
    one of other arguments."""
    if isinstance(scene, type):
        raise TypeError(f"`scene` must be a scene or a system, but is {kind_of(scene)}.")
    if callable(scene) and cost is not None and not callable(cost):
        raise TypeError(
            f"The scene comes first and the cost second, but a {type(cost).__name__} stands in the place of the cost."
        )
    if cost is not None and not callable(cost):
        raise TypeError(f"`cost` must be a function cost(scene, simulate) -> scalar, but is {kind_of(cost)}.")
    if cost is not None:
        _must_take_both(scene, cost)
        return cost
    missing = what_is_missing(scene)
    if missing:
        raise TypeError(
            f"`cost` must be given for a {type(scene).__name__}, which has no {', '.join(missing)}: "
            "cost(scene, simulate) -> scalar."
        )
    return running_cost_functional


def what_is_missing(scene) -> list[str]:
    """What is `NEEDED` and a scene or a system does not have."""
    return [name for name in NEEDED if not hasattr(scene, name)]


def _must_take_both(scene, cost: Cost) -> None:
    try:
        inspect.signature(cost).bind(scene, None)
    except ValueError:  # one that does not tell its arguments
        return
    except TypeError as error:
        name = getattr(cost, "__name__", str(cost))
        raise TypeError(
            "`cost` must take two arguments, cost(scene, simulate), and move the scene by `simulate`, in whose place "
            f"each method puts its own; but it is {name}{inspect.signature(cost)}. Write `def {name}(scene, "
            "simulate=hybridsens.simulate)`, of a system `solve=hybridsens.solve`, and move it by that."
        ) from error


def functional(parameters: FlatParameters, cost: Cost, simulate: Callable) -> Callable:
    """vector -> (J, CallReport). Motions are asked not to raise by themselves; see `raise_unless_reached_end`.

    Raises: TypeError when traced if the cost is not a real scalar, or has settings of its own.
    """

    def value(vector: Float[Array, "parameter"]):
        motions = []

        def recording(*arguments, **settings):
            _must_leave_settings(settings)
            motions.append(simulate(*arguments, **settings))
            return motions[-1]

        J = _real_scalar(cost(parameters.rebuild(vector), recording))
        if not motions:
            raise TypeError(_OWN_MOTION)
        known = [motion for motion in motions if isinstance(motion, Trajectory | Solution)]
        each = lambda what: tuple(map(what, known))
        return J, CallReport(each(lambda m: m.status), each(lambda m: m.events.count), each(lambda m: m.doubt_time))

    return value


def _must_leave_settings(given: Mapping[str, Any]) -> None:
    own = [name for name in given if name in (*Settings.__annotations__, "adjoint", "throw")]
    if own:
        raise TypeError(
            f"`cost` must leave the settings to the function that it is given, but gives it {', '.join(own)}. Leave "
            "them out of the cost, and give settings to the study, as in check_gradient(scene, cost, rtol=1e-10)."
        )


@contextlib.contextmanager
def told_of_the_cost() -> Iterator[None]:
    """Errors that a cost brings about, in words about the cost: JAX and `solve` speak of what they see of it."""
    try:
        yield
    except jax.errors.UnexpectedTracerError as error:
        raise TypeError(
            "`cost` must call the function that it is given outside of jax.jit, jax.vmap and the loops of JAX, since "
            "each motion is looked at by itself, but calls it inside of one: write a Python loop, which is compiled."
        ) from error
    except TypeError as error:
        if "custom_vjp" in str(error):
            raise TypeError(
                "What the cost and its scene do must have derivatives in forward mode too, since forward sensitivities "
                "are compared, but something in them is a jax.custom_vjp, which has none: write it as a "
                "jax.custom_jvp, which serves both modes."
            ) from error
        if str(error) not in (REVERSE_ONLY, FORWARD_ONLY):
            raise
        raise TypeError(_OWN_MOTION) from error


def _real_scalar(J: Any) -> Float[Array, ""]:
    must = "`cost` must return a real scalar, but returns"
    if J is None:
        raise TypeError(f"{must} None: is a `return` missing?")
    if not isinstance(J, jax.Array | np.ndarray | np.generic | float):
        remedy = ": take a number from it, `.final.q[0]` or `.cost`" if isinstance(J, Trajectory | Solution) else ""
        raise TypeError(f"{must} {type(J).__name__}{remedy}.")
    J = jnp.asarray(J)
    if J.shape != () or not jnp.issubdtype(J.dtype, jnp.floating):
        raise TypeError(f"{must} {J.dtype} of shape {J.shape}.")
    return J


def all_reached_end(reported: CallReport) -> bool:
    """Whether every motion of ours is whole. One that grazed a contact is: what that costs the gradient, a study
    measures."""
    return all(bool(status.reached_end) for status in reported.status)


def raise_unless_reached_end(reported: CallReport) -> None:
    """Raise SimulationError if a motion of ours is not whole."""
    for status in reported.status:
        if not status.reached_end:
            raise SimulationError(str(status))
