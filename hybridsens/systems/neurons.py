"""Leaky integrate-and-fire neurons with exponential synapses, coupled as a matrix of weights says."""

import jax.numpy as jnp
from jaxtyping import Array, Float

from .shipped import ShippedSystem, parameter


class Neurons(ShippedSystem):
    """tau_m v' = drive - v + i and tau_s i' = -i, for each neuron; time is in milliseconds.

    Where v_k rises to `threshold`, neuron k fires: v_k falls to 0 and every i_j grows by `weights[j, k]`. At
    `input_times[m]` every i_j grows by `input_weights[j, m]`. A full matrix couples all to all, one that is zero on
    and above its diagonal feeds forward. Event k < neurons is neuron k firing, event neurons + m is input m.

    The gradient of what is made of spike times by the weights is that of EventProp. J is the integral of |v|^2."""

    t1 = 12.0

    weights: Float[Array, "neuron neuron"] = parameter(((0.0, 0.2, -0.4), (0.7, 0.0, 0.3), (0.5, 0.6, 0.0)))
    """What i of the row's neuron gains when the column's fires."""
    input_weights: Float[Array, "neuron input"] = parameter(((2.4, 0.3, 1.9), (0.5, 1.8, 0.4), (0.3, 0.9, 1.1)))
    """What i of the row's neuron gains at the column's input."""
    input_times: Float[Array, "input"] = parameter((0.5, 2.0, 4.5))
    """When inputs come [ms]."""
    drive: Float[Array, "neuron"] = parameter((0.2, 0.0, 0.1))
    """Constant current of each neuron."""
    membrane_time: Float[Array, ""] = parameter(3.0)
    """tau_m [ms]"""
    synapse_time: Float[Array, ""] = parameter(1.5)
    """tau_s [ms]"""
    threshold: Float[Array, ""] = parameter(0.5)
    """v at which a neuron fires."""

    @property
    def event_names(self):  # type: ignore[override]
        neurons, inputs = self.input_weights.shape
        return *(f"neuron {k}" for k in range(neurons)), *(f"input {m}" for m in range(inputs))

    def initial_state(self):
        return {"v": jnp.zeros_like(self.drive), "i": jnp.zeros_like(self.drive)}

    def running_cost(self, t, x, mode):
        return x["v"] @ x["v"]

    def flow(self, t, x, mode):
        return {"v": (self.drive - x["v"] + x["i"]) / self.membrane_time, "i": -x["i"] / self.synapse_time}

    def guards(self, t, x, mode):
        return self.threshold - x["v"]

    def scheduled_times(self, x, mode):
        return self.input_times

    def transition(self, event, t, x, mode):
        fires = jnp.arange(self.drive.shape[0]) == event
        kicks = jnp.concatenate([self.weights, self.input_weights], axis=1)[:, event]
        return {"v": jnp.where(fires, 0.0, x["v"]), "i": x["i"] + kicks}, mode
