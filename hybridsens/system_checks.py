"""What a hybrid system must be: structures, shapes and types of what its functions return, before anything runs."""

from collections.abc import Callable
from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp

from .system import AbstractHybridSystem
from .validation.asked import Asked, is_method, kind_of
from .validation.lost_derivatives import hides_tracers, method_of, undifferentiated, warn_of_mode_after
from .validation.own_start import other_structure_told
from .validation.program import digest, traced
from .validation.returned import must_have_shape, must_match, outcome, returned_array, returned_leaves
from .validation.transition import check_change


def state_as_arrays(x0) -> tuple[Any, Any]:
    """The state with arrays for leaves, and their one type. Raises: TypeError where a leaf is no real number."""
    _must_be_called("x0", x0)
    leaves, tree = jax.tree.flatten(x0)
    if not leaves:
        raise TypeError(f"`x0` must hold real numbers, but is {x0!r}.")
    arrays = [_real(leaf) for leaf in leaves]
    if not any(array.size for array in arrays):
        raise TypeError(f"`x0` must hold real numbers, but its arrays are empty: {x0!r}.")
    dtype = jnp.result_type(*arrays)
    return tree.unflatten([array.astype(dtype) for array in arrays]), dtype


def _must_be_called(name: str, given: Any) -> None:
    """Raise TypeError for a method in the place of what it returns."""
    if is_method(given):
        raise TypeError(f"`{name}` must be a PyTree of arrays or numbers, but is {kind_of(given)}.")


def _real(leaf) -> jax.Array:
    try:
        array = jnp.asarray(float(leaf) if isinstance(leaf, int) else leaf)
    except (TypeError, ValueError, OverflowError) as error:
        raise TypeError(f"`x0` must hold real numbers, but has a leaf {type(leaf).__name__}.") from error
    if not jnp.issubdtype(array.dtype, jnp.floating):
        whole = ": what counts belongs into the mode, and what flows is a float, 1.0 in place of 1"
        remedy = whole if jnp.issubdtype(array.dtype, jnp.integer) else ""
        raise TypeError(f"`x0` must hold real numbers, but has a leaf of type {array.dtype}{remedy}.")
    return array


def mode_as_arrays(mode) -> Any:
    """The mode with arrays for leaves, held constant. Raises: TypeError where a leaf cannot be one."""
    _must_be_called("mode", mode)

    def array(leaf):
        try:
            found = jnp.asarray(leaf)
        except (TypeError, ValueError, OverflowError) as error:
            raise TypeError(
                f"`mode` must hold numbers or arrays, but has a leaf {type(leaf).__name__}: number the modes."
            ) from error
        if jnp.issubdtype(found.dtype, jax.dtypes.prng_key):
            raise TypeError(
                "`mode` must hold numbers or arrays, but has a random key of a type of its own: put "
                "jax.random.key_data(key) there, and take the key from it by jax.random.wrap_key_data."
            )
        return found

    return undifferentiated(jax.tree.map(array, mode))


class Counts(NamedTuple):
    """How many events of each sort a system has."""

    guards: int
    scheduled: int | None
    """Scheduled times; None where the system does not speak of any."""


def check_system(system: AbstractHybridSystem, running_cost, t, x, mode) -> tuple[Counts, Any]:
    """How many guards and scheduled times there are, and what the running cost looks like.

    Raises: ValueError or TypeError where the system's functions do not fit the state, the mode or each other."""
    like = lambda tree: jax.tree.map(lambda leaf: jax.ShapeDtypeStruct(leaf.shape, leaf.dtype), tree)
    t, x, mode = like((t, x, mode))
    flow, guards = (Asked.of(system, f"{name}(t, x, mode)") for name in ("flow", "guards"))
    try:
        rate = outcome(flow, t, x, mode)
    except (TypeError, AttributeError, KeyError, IndexError) as error:
        told = other_structure_told(system, x, mode)
        if told:
            raise TypeError(told) from error
        raise
    must_match(flow, "the state's rate", rate, x, exact=False)
    guards = must_have_shape(guards, returned_array(guards, t, x, mode), ("guard",))
    counts = Counts(guards.shape[0], _scheduled_count(system, x, mode))
    if counts != (0, None):
        check_change(Asked.of(system, "transition(event, t, x, mode)"), "(x, mode)", "the state", x, (t, x, mode))
    if running_cost is None:
        return counts, None
    returned_leaves(Asked("running_cost(system, t, x, mode)", running_cost), system, t, x, mode)
    return counts, eqx.filter_eval_shape(running_cost, system, t, x, mode)


def _scheduled_count(system: AbstractHybridSystem, x, mode) -> int | None:
    asked = Asked.of(system, "scheduled_times(x, mode)")
    if outcome(asked, x, mode) is None:
        return None
    return must_have_shape(asked, returned_array(asked, x, mode), ("time",)).shape[0] or None


def warn_of_transition(system: AbstractHybridSystem, t, x, mode) -> None:
    """Say where the transition writes what is differentiable into the mode."""
    warn_of_mode_after(
        lambda system, *given: system.transition(*given), system, (jnp.asarray(0), t, x, mode),
        f"`transition` of {type(as_written(system)).__name__}", "Keep it in x, with a rate of 0.",
    )  # fmt: skip


class WrappedSystem(AbstractHybridSystem):
    """A system around the one that the user wrote."""

    system: AbstractHybridSystem

    @property
    def known_discontinuities(self):  # type: ignore[override]
        return self.system.known_discontinuities


class LiftedSystem(WrappedSystem):
    """A system whose functions' hidden traced values are leaves."""

    functions: dict[str, Callable]

    def flow(self, t, x, mode):
        return self.functions["flow"](self.system, t, x, mode)

    def guards(self, t, x, mode):
        return self.functions["guards"](self.system, t, x, mode)

    def transition(self, event, t, x, mode):
        return self.functions["transition"](self.system, event, t, x, mode)

    def scheduled_times(self, x, mode):
        return self.functions["scheduled_times"](self.system, x, mode)


def as_written(system: AbstractHybridSystem) -> AbstractHybridSystem:
    """The system that the user wrote: the one that a running cost is given."""
    while isinstance(system, WrappedSystem):
        system = system.system
    return system


def lifted(system: AbstractHybridSystem, running_cost, t, x, mode):
    """The system and the running cost, with every traced value that they close over turned into a leaf: a custom
    derivative rule would not see it otherwise; and what names the program of their functions."""
    calls = {
        "flow": (method_of("flow"), given := (system, t, x, mode)),
        "guards": (method_of("guards"), given),
        "transition": (method_of("transition"), (system, jnp.asarray(0), t, x, mode)),
        "scheduled_times": (method_of("scheduled_times"), (system, x, mode)),
    }
    traces = {name: traced(*call) for name, call in calls.items()}
    costs = [] if running_cost is None else [traced(running_cost, given)]
    if running_cost is not None and any(map(hides_tracers, costs)):
        written = running_cost
        running_cost = eqx.filter_closure_convert(lambda *given: written(*given), *given)
    if any(map(hides_tracers, traces.values())):
        functions = {name: eqx.filter_closure_convert(call, *given) for name, (call, given) in calls.items()}
        system = LiftedSystem(system, functions)
    return system, running_cost, digest([*traces.values(), *costs])
