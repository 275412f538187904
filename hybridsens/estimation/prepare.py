"""From what a user says to a least-squares problem: observations by name, weights, priors, the horizon."""

from collections.abc import Callable, Mapping, Sequence
from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np

from ..mechanics.scene import State
from ..mechanics.switches import has_switches
from ..system import AbstractHybridSystem
from ..validation.asked import Asked
from ..validation.spelling import did_you_mean
from .data import Measurements
from .motions import FixedSettings, Start, entries, picks
from .parameters import Bounds, Selection, select
from .problem import Observations, Prior, Problem

SETTINGS = dict(rtol=1e-8, atol=1e-8, max_events=256, max_steps=4096)
"""What the motions of a fit are computed with by default."""
BEYOND = 0.1
"""How far beyond the last measured event a motion goes on, relative to the time until then."""


class Unknowns(NamedTuple):
    """What is fitted, and what is known of it beforehand; see `fit`."""

    parameters: str | Sequence[str] | None = None
    bounds: Bounds | None = None
    priors: Mapping[str, Any] | None = None


class Experiment(NamedTuple):
    """The motion that was measured: how it began, what was seen of it, and when; see `fit`."""

    state: Any = None
    mode: Any = None
    observe: Callable[..., Any] | None = None
    t0: float = 0.0
    t1: float | None = None
    settings: Mapping[str, Any] = SETTINGS
    """`Settings` of `simulate` or `solve`."""


def build_problem(
    scene, data: Measurements, unknowns: Unknowns, experiment: Experiment = Experiment(), robust: float | None = None,  # noqa: B008
) -> Problem:  # fmt: skip
    """The least-squares problem of a fit.

    Raises: ValueError or TypeError for what does not fit together.
    """
    scene = concrete(scene)
    begin = beginning(scene, experiment.state, experiment.mode)
    selection = select(scene, unknowns.parameters, unknowns.bounds)
    end = horizon(data, experiment.t0, experiment.t1)
    observe = observer(experiment.observe, scene, begin.of(scene), data.names)
    return Problem(
        scene, selection, begin, observe, observations(data), prior(selection, unknowns.priors),
        jnp.asarray(float(experiment.t0)), jnp.asarray(end), jnp.asarray(sigma_unit(data)),
        jnp.asarray(jnp.inf if robust is None else float(robust)), FixedSettings.of(experiment.settings),
    )  # fmt: skip


class StateObserver(eqx.Module):
    """Entries of (q, v), or of x. Hashable and comparable, so that a second fit of the same columns compiles
    nothing."""

    picks: tuple[int, ...] = eqx.field(static=True)

    def __call__(self, scene, t, *state):
        del scene, t
        return entries(state)[np.array(self.picks, int)]


class NamedObserver(eqx.Module):
    """An observation function with its result in the order of the columns."""

    function: Callable[..., Any] = eqx.field(static=True)
    names: tuple[str, ...] = eqx.field(static=True)

    def __call__(self, scene, t, *state):
        seen = self.function(scene, t, *state)
        if isinstance(seen, Mapping):
            seen = jnp.stack([seen[name] for name in self.names])
        return jnp.atleast_1d(seen)


def observer(observe: Callable[..., Any] | None, scene, start: tuple, names: tuple[str, ...]) -> Callable[..., Any]:
    """The observation function, checked against the columns.

    Raises: ValueError if what it returns does not fit the columns.
    """
    if not names:
        return StateObserver(())
    if observe is None:
        return StateObserver(picks(names, start))
    state = (start[0].q, start[0].v) if isinstance(start[0], State) else (jax.tree.map(jnp.asarray, start[0]),)
    form = "observe(scene, t, q, v)" if isinstance(start[0], State) else "observe(system, t, x)"
    seen = eqx.filter_eval_shape(Asked(form, observe), scene, jnp.zeros(()), *state)
    if seen is None:
        raise TypeError("`observe` must return what was measured, but returns None: is a `return` missing?")
    if isinstance(seen, Mapping):
        unknown = [name for name in names if name not in seen]
        if unknown:
            raise ValueError(
                f"`observe` must return all columns {list(names)}, but has no {unknown}: it has {list(seen)}."
            )
    elif np.shape(seen) not in ((len(names),), () if len(names) == 1 else None):
        raise ValueError(
            f"`observe` must return shape ({len(names)},) for {list(names)}, but returns {np.shape(seen)}."
        )
    return NamedObserver(observe, names)


def observations(data: Measurements) -> Observations:
    """Measurements with weights 1 / sigma in the place of gaps and sigmas."""
    known = np.isfinite(data.values)
    sigmas = np.ones_like(data.values) if data.sigmas is None else data.sigmas
    contacts = data.event_contacts
    ranks = [int(np.sum(contacts[:k] == contacts[k])) for k in range(contacts.size)]
    if np.any(contacts < 0) and np.any(contacts >= 0):
        raise ValueError(f"`event_contacts` must be known for all event times or for none, but has {contacts}.")
    seen = np.isfinite(data.event_times)
    event_times, event_weights = np.where(seen, data.event_times, 0), np.where(seen, 1 / data.event_sigmas, 0)
    arrays = (data.times, np.where(known, data.values, 0), np.where(known, 1 / sigmas, 0), event_times, event_weights,
              contacts, np.array(ranks, int))  # fmt: skip
    return Observations(*(jnp.asarray(a) for a in arrays))


def prior(selection: Selection, priors: Mapping[str, Any] | None) -> Prior:
    """Normal priors from name -> (mean, sigma).

    Raises: ValueError for a name that is not fitted, or a sigma that is not positive.
    """
    mean, weight = np.zeros(len(selection.labels)), np.zeros(len(selection.labels))
    for name, (middle, sigma) in (priors or {}).items():
        if name not in selection.labels:
            raise ValueError(
                f"`priors` must have names among {list(selection.labels)}, but has {name!r}."
                f"{did_you_mean(name, selection.labels)}"
            )
        if not sigma > 0:
            raise ValueError(f"The prior of {name!r} must have a positive sigma, but has {sigma}.")
        place = selection.labels.index(name)
        mean[place], weight[place] = middle, 1 / sigma
    return Prior(jnp.asarray(mean), jnp.asarray(weight))


def horizon(data: Measurements, t0: float, t1: float | None) -> float:
    """End of the horizon: t1; or the last time measured, and a tenth of the time beyond the last event, so that a
    motion whose event comes later is seen to have it.

    Raises: ValueError if a time lies outside [t0, t1].
    """
    events = data.event_times[np.isfinite(data.event_times)]
    times = np.concatenate([data.times, events])
    last = float(np.max(np.concatenate([data.times, t0 + (1 + BEYOND) * (events - t0)])))
    t1 = last if t1 is None else float(t1)
    outside = times[(times < t0) | (times > t1)]
    if outside.size:
        raise ValueError(f"All measured times must lie in the horizon [{t0}, {t1}], but {outside[:5]} do not.")
    if not t1 > t0:
        raise ValueError(f"The horizon must have t1 > t0, but has t0 = {t0} and t1 = {t1}.")
    return t1


def sigma_unit(data: Measurements) -> float:
    """How large a residual of one sigma is: 1, or a percent of the data's spread where no sigmas were given."""
    if data.sigmas is not None or data.values.size == 0:
        return 1.0
    return 0.01 * float(np.nanmax(np.nanstd(data.values, axis=0))) or 1.0


def beginning(scene, state: Any, mode: Any) -> Start:
    """Where motions begin: as given, or as the scene itself has it.

    Raises: TypeError if there is no initial state, or one of the wrong type.
    """
    if state is None:
        if not hasattr(scene, "initial_state"):
            raise TypeError(f"`state` must be given, since {type(scene).__name__} has no method `initial_state`.")
        state = _own_initial_state
    general = isinstance(scene, AbstractHybridSystem)
    if not (general or callable(state) or isinstance(state, State)):
        raise TypeError(f"`state` must be a State, a function of the scene, or None, but is {type(state).__name__}.")
    if mode is not None and not (general or has_switches(scene)):
        raise TypeError("`mode` must be left out for a scene without switches, whose contacts choose their own.")
    if mode is None and hasattr(scene, "initial_mode"):
        mode = _own_initial_mode
    return Start(state if callable(state) else _Fixed(concrete(state)), mode)


def _own_initial_state(scene):
    return scene.initial_state()


def _own_initial_mode(system):
    return system.initial_mode()


class _Fixed(eqx.Module):
    state: Any

    def __call__(self, scene):
        del scene
        return self.state


def concrete(tree):
    """Numbers of a scene as arrays of the default floating point type where they were given as Python floats."""
    return jax.tree.map(lambda leaf: jnp.asarray(leaf) if isinstance(leaf, float) else leaf, tree)
