"""From what a user says to a least-squares problem: weights, priors, the horizon, where motions begin."""

from collections.abc import Callable, Mapping, Sequence
from operator import methodcaller
from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np

from ..mechanics.scene import State
from ..mechanics.switches import has_switches
from ..system import AbstractHybridSystem
from ..system_checks import state_as_arrays
from ..validation.arguments import as_real, by_name, pair
from ..validation.spelling import did_you_mean
from .data import Measurements
from .motions import FixedSettings, Start, event_count
from .observers import observer
from .parameters import Bounds, Selection, by_entry, select
from .problem import FitProblem, Observations, Prior

SETTINGS = dict(rtol=1e-8, atol=1e-8, max_events=256, max_steps=4096)
"""What the motions of a fit are computed with by default."""
BEYOND = 0.1
"""How far beyond the last measured event a motion goes on, relative to the time until then."""
OWN_STATE, OWN_MODE = methodcaller("initial_state"), methodcaller("initial_mode")
"""Of a scene or a system that says where it begins."""


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
) -> FitProblem:  # fmt: skip
    """The least-squares problem of a fit.

    Raises: ValueError or TypeError for what does not fit together.
    """
    if by_name("priors", unknowns.priors):
        _check_sigmas(data, "priors", "priors are given")
    scene = concrete(scene)
    begin = beginning(scene, experiment.state, experiment.mode)
    selection = select(scene, unknowns.parameters, unknowns.bounds)
    end, start = horizon(data, experiment.t0, experiment.t1), begin.of(scene)
    observe = observer(experiment.observe, scene, start, data.names)
    if data.any_events:
        _check_events(data.event_contacts, type(scene).__name__, event_count(scene, start))
    return FitProblem(
        scene, selection, begin, observe, observations(data), prior(selection, unknowns.priors),
        jnp.asarray(float(experiment.t0)), jnp.asarray(end), jnp.asarray(sigma_unit(data)),
        jnp.asarray(jnp.inf if robust is None else float(robust)), FixedSettings.of(experiment.settings),
    )  # fmt: skip


def observations(data: Measurements) -> Observations:
    """Measurements with weights 1 / sigma in the place of gaps and sigmas.

    Raises: ValueError if values without sigmas are to be weighed against event times, or some contacts are unknown.
    """
    if data.any_events:
        _check_sigmas(data, "event times", "event times are fitted too")
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


def _check_sigmas(data: Measurements, others: str, where: str) -> None:
    """Raises: ValueError if values without sigmas are to be weighed against others, whose sigmas are known."""
    if not data.sigmas_known:
        raise ValueError(
            f"The values must have sigmas where {where}, but have none: give `sigma` (or columns sigma_<name>), by "
            f"which {others} are weighed against values. A fit of the values alone estimates it: "
            "`result.uncertainty.noise`."
        )


def _check_events(contacts: np.ndarray, name: str, count: int) -> None:
    """Raises: ValueError if motions have no events, or not those that were measured."""
    if count == 0:
        raise ValueError(
            f"{name} must have events where event times are fitted (contacts of a scene, guards or scheduled times of "
            "a system), but has none. Leave `event_times` out, or write what happens then."
        )
    if np.max(contacts) >= count:
        raise ValueError(f"`event_contacts` must be below {count}, the number of events of {name}, but has {contacts}.")


def prior(selection: Selection, priors: Mapping[str, Any] | None) -> Prior:
    """Normal priors from name -> (mean, sigma).

    Raises: ValueError for a name that is not fitted, or what is no pair of a number and a positive one.
    """
    mean, weight = np.zeros(len(selection.labels)), np.zeros(len(selection.labels))
    for name, given in by_entry("priors", priors).items():
        if name not in selection.labels:
            raise ValueError(
                f"`priors` must have names among {list(selection.labels)}, but has {name!r}."
                f"{did_you_mean(name, selection.labels)}"
            )
        middle, sigma = map(as_real, pair(given) or (None, None))
        if not (sigma > 0 and np.isfinite(middle)):
            raise ValueError(
                f"The prior of {name!r} must be a pair (mean, sigma), a number and a positive one, but is {given!r}."
            )
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
    return 1.0 if data.sigmas is not None else 0.01 * data.spread or 1.0


def beginning(scene, state: Any, mode: Any) -> Start:
    """Where motions begin: as given, or as the scene itself has it.

    Raises: TypeError if there is no initial state, or one of the wrong type.
    """
    if state is None:
        if not hasattr(scene, "initial_state"):
            raise TypeError(f"`state` must be given, since {type(scene).__name__} has no method `initial_state`.")
        state = OWN_STATE
    general = isinstance(scene, AbstractHybridSystem)
    if not (general or callable(state) or isinstance(state, State)):
        raise TypeError(f"`state` must be a State, a function of the scene, or None, but is {type(state).__name__}.")
    if mode is not None and not (general or has_switches(scene)):
        raise TypeError("`mode` must be left out for a scene without switches, whose contacts choose their own.")
    if mode is None and hasattr(scene, "initial_mode"):
        mode = OWN_MODE
    if not callable(state):
        state = _Fixed(state_as_arrays(state)[0] if general else concrete(state))
    return Start(state, mode)


class _Fixed(eqx.Module):
    state: Any

    def __call__(self, scene):
        del scene
        return self.state


def concrete(tree):
    """Numbers of a scene as arrays of the default floating point type where they were given as Python floats."""
    return jax.tree.map(lambda leaf: jnp.asarray(leaf) if isinstance(leaf, float) else leaf, tree)
