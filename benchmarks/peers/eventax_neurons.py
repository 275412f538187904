"""eventax: spiking networks by Diffrax solves between events, with EventProp or a checkpointed gradient.

`network` gives the neurons of `hybridsens.systems.Neurons` in its terms. Its thresholds and time constants are no
parameters; gradients are by weights and drive.
"""

import importlib.util
from typing import NamedTuple

import diffrax
import jax.numpy as jnp
import numpy as np

from . import reference


def available() -> str | None:
    """Why this peer cannot run here, or `None` if it can."""
    return None if importlib.util.find_spec("eventax") else "eventax is not installed (pip install eventax==0.1.0)"


class Setting(NamedTuple):
    """How it integrates: fixed steps of a solver, and the adjoint."""

    solver: str
    step: float
    adjoint: str


def network(neurons, horizon: float, setting: Setting, most_events: int):
    """The network, and its input spikes of shape (input, 1)."""
    reference.require(available())
    import jax
    import optimistix
    from eventax.adjoint import EventPropAdjoint
    from eventax.evnn import EvNN
    from eventax.neuron_models import LIF

    count, inputs = neurons.input_weights.shape
    adjoint = EventPropAdjoint() if setting.adjoint == "EventProp" else diffrax.RecursiveCheckpointAdjoint()
    made = EvNN(
        LIF, count, horizon, inputs, jax.random.key(0), dtype=jnp.float64, wmask=jnp.ones((count + inputs, count)),
        max_event_steps=most_events, solver_stepsize=setting.step, solver=getattr(diffrax, setting.solver)(),
        root_finder=optimistix.Newton(1e-10, 1e-10), adjoint=adjoint,
        init_weights=jnp.zeros((count + inputs, count)), init_bias=jnp.zeros(count),
        thresh=float(neurons.threshold), tmem=float(neurons.membrane_time), tsyn=float(neurons.synapse_time),
    )  # fmt: skip
    return made, np.asarray(neurons.input_times)[:, None]


def spike_times(made, inputs, weights, drive, horizon: float, most: int):
    """Sum of all output spike times up to the horizon; `most` is what one list of them, and all, may hold."""
    import equinox as eqx

    made = eqx.tree_at(lambda m: (m.neuron_model.weights, m.neuron_model.ic), made, (weights, drive))
    times = made.spikes_until_t(jnp.asarray(inputs), horizon, most)
    return jnp.sum(jnp.where(times <= horizon, times, 0.0))
