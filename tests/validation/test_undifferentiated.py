"""The mode is not differentiated: what would need it is told, by name, and nothing else is."""

import warnings

import equinox as eqx
import jax
import jax.numpy as jnp
import pytest

import hybridsens as hs


class Relay(hs.AbstractHybridSystem):
    """Something that falls, and at each event writes down what `written` says."""

    rate: jax.Array
    gain: jax.Array
    written: str = eqx.field(static=True)

    def flow(self, t, x, mode):
        return -self.rate * mode["gain"]

    def guards(self, t, x, mode):
        return x[None]

    def transition(self, event, t, x, mode):
        values = {
            "time": t, "state": 2 * x, "parameter": self.gain, "constant": 2.0, "count": mode["gain"] + 1.0,
            "sign": jnp.sign(x), "chosen": jnp.where(x > 0.5, 2.0, 3.0), "stopped": jax.lax.stop_gradient(t),
            "branch": jax.lax.cond(x > 0, lambda: self.gain, lambda: jnp.ones(())),
        }  # fmt: skip
        return x + 1, {"gain": jnp.asarray(values[self.written], float), "number": mode["number"] + 1}


def run(system, gain=1.0):
    return hs.solve(system, 1.0, {"gain": gain, "number": 0}, t1=1.5, throw=False).final


@pytest.mark.parametrize("written", ["time", "state", "parameter", "branch"])
def test_what_an_event_writes_into_the_mode_and_would_need_a_derivative_is_named(written):
    told = r"`transition` of Relay writes into mode\['gain'\] what depends on t.*Keep it in x.*stop_gradient"
    with pytest.warns(UserWarning, match=told):
        eqx.filter_eval_shape(run, Relay(1.0, 2.0, written))


ALSO_SLOW = [pytest.param(way, marks=pytest.mark.slow) for way in ("count", "chosen")]


@pytest.mark.parametrize("written", ["constant", "sign", "stopped", *ALSO_SLOW])
def test_what_has_no_derivative_to_lose_is_not_told(written):
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        jax.eval_shape(jax.grad(lambda rate: run(Relay(rate, 2.0, written))), 1.0)


@pytest.mark.parametrize("differentiate", [jax.grad, lambda f: jax.grad(jax.jit(f)), lambda f: jax.jit(jax.grad(f))])
def test_a_derivative_by_the_initial_mode_is_told(differentiate):
    with pytest.warns(UserWarning, match=r"taken by what mode\['gain'\] is made from.*Make it a field"):
        jax.eval_shape(differentiate(lambda gain: run(Relay(1.0, 2.0, "constant"), gain)), 1.0)


class Clutch(hs.AbstractSwitchedScene):
    """A mass whose force is what the switch wrote down."""

    def mass_matrix(self, q):
        return jnp.eye(1)

    def force(self, t, q, v, mode):
        return -mode[None]

    def gap(self, t, q):
        return jnp.zeros(0)

    def restitution(self):
        return jnp.zeros(0)

    def switches(self, t, q, v, mode):
        return q

    def switch(self, event, t, q, v, mode):
        return v, v[0] ** 2


def test_what_a_switch_writes_into_the_mode_is_named():
    with pytest.warns(UserWarning, match=r"`switch` of Clutch writes into mode what depends on t.*velocity of a coord"):
        jax.eval_shape(lambda: hs.simulate(Clutch(), hs.State([1.0], [0.0]), jnp.ones(()), t1=2.0))
