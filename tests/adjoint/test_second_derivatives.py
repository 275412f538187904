"""Hessians by parameters and by times, and sample times that fall on each other, on an event or on an end: against a
closed form."""

import jax
import jax.numpy as jnp
import pytest

import hybridsens as hs
from tests.closeness import assert_close


class Dose(hs.AbstractHybridSystem):
    """What is there decays; a dose is added at a known time."""

    decay: jax.Array
    dose_time: jax.Array

    def flow(self, t, x, mode):
        return -self.decay * x

    def guards(self, t, x, mode):
        return jnp.zeros(0)

    def scheduled_times(self, x, mode):
        return self.dose_time[None]

    def transition(self, event, t, x, mode):
        return x + 2.0, mode


def there(decay, dose_time, x0, t0, t):
    """What is there at time t, the dose included from its time on."""
    dosed = jnp.exp(-decay * (t - dose_time))
    return x0 * jnp.exp(-decay * (t - t0)) + jnp.where(t >= dose_time, 2 * dosed, 0)


def numbers(dose_time, sample_times):
    """decay, dose time, x0, t0, t1, sample times."""
    return jnp.array([0.7, dose_time, 1.3, 0.4, 2.0, *sample_times])


def cost(p, adjoint=None):
    motion = hs.solve(Dose(p[0], p[1]), p[2], t0=p[3], t1=p[4], ts=p[5:], adjoint=adjoint)
    return motion.final + jnp.sum(motion.x**2 * jnp.arange(1, p.size - 4))


def exact(p):
    at = lambda t: there(*p[:4], t)
    return at(p[4]) + jnp.sum(jax.vmap(at)(p[5:]) ** 2 * jnp.arange(1, p.size - 4))


gradient = jax.jit(jax.grad(cost))
over_reverse = jax.jit(jax.jacfwd(jax.grad(cost)))
over_forward = jax.jit(jax.jacfwd(jax.jacfwd(lambda p: cost(p, hs.ForwardSensitivities()))))

PLACES = {
    "between": (0.7, 1.5, 1.8, 1.9),
    "ends": (0.4, 0.4, 2.0, 2.0),
    "event": (0.9, 1.2, 1.2, 1.6),
}


@pytest.mark.parametrize("place", PLACES)
def test_a_sample_time_given_twice_counts_twice(place):
    p = numbers(1.2, PLACES[place])
    assert_close(gradient(p), jax.grad(exact)(p), 1e-7)


@pytest.mark.slow
@pytest.mark.parametrize("hessian", [over_reverse, over_forward], ids=["over reverse", "over forward"])
@pytest.mark.parametrize("place", PLACES)
def test_hessian_by_parameters_and_all_times(place, hessian):
    p = numbers(1.2, PLACES[place])
    assert_close(hessian(p), jax.hessian(exact)(p), 1e-6)


in_either_mode = pytest.mark.parametrize(
    "method", [pytest.param(jax.grad, id="reverse"), pytest.param(jax.jacfwd, id="forward", marks=pytest.mark.slow)]
)


@in_either_mode
def test_what_broke_off_does_not_depend_on_the_end_of_the_horizon(method):
    p = numbers(1.2, ())
    adjoint = hs.ForwardSensitivities() if method is jax.jacfwd else None
    stopped = lambda p: hs.solve(
        Dose(p[0], p[1]), p[2], t0=p[3], t1=p[4], max_steps=3, throw=False, adjoint=adjoint
    ).final
    of_t0, of_t1 = method(stopped)(p)[3:]
    assert of_t1 == 0
    assert of_t0 != 0


@in_either_mode
def test_what_could_not_begin_is_the_initial_state(method):
    p = numbers(1.2, ()).at[4].set(0.1)
    adjoint = hs.ForwardSensitivities() if method is jax.jacfwd else None
    stays = lambda p: hs.solve(Dose(p[0], p[1]), p[2], t0=p[3], t1=p[4], throw=False, adjoint=adjoint).final
    assert_close(method(stays)(p), jnp.array([0.0, 0.0, 1.0, 0.0, 0.0]), 1e-12)
