"""The short way to the number before another finds the same number, and only solves of ours use it."""

import diffrax
import equinox.internal as eqxi
import jax
import jax.numpy as jnp
import numpy as np
import pytest

import hybridsens as hs
from hybridsens.forward.clip_floor import prevbefore, short_clip_floor


@pytest.mark.parametrize("dtype", [np.float32, np.float64])
def test_it_is_the_number_before(dtype):
    """On both sides of powers of two, where the spacing changes, and at 0."""
    random = np.random.default_rng(0)
    anywhere = random.standard_normal(100_000) * 10.0 ** random.integers(-20, 20, 100_000)
    powers = np.outer([-1, 1], 2.0 ** np.arange(-60, 60)).ravel()
    near_powers = np.concatenate([np.nextafter(powers.astype(dtype), dtype(way)) for way in (-np.inf, np.inf)])
    t = jnp.asarray(np.concatenate([anywhere, powers, near_powers, [0.0]]), dtype)
    np.testing.assert_array_equal(jax.jit(prevbefore)(t), eqxi.prevbefore(t))


def steps_on_bits(solve) -> int:
    return str(jax.make_jaxpr(solve)(1.0)).count("nextafter")


def test_a_motion_needs_no_steps_on_bits_and_other_solves_keep_theirs():
    ball = hs.scenes.BouncingBall()
    assert steps_on_bits(lambda t1: hs.simulate(ball, ball.initial_state(), t1=t1, throw=False).final.q) == 0
    fall = diffrax.ODETerm(lambda t, y, args: -y)
    own = lambda t1: diffrax.diffeqsolve(fall, diffrax.Tsit5(), 0.0, t1, 0.1, 1.0).ys
    with short_clip_floor():
        pass
    assert steps_on_bits(own) == steps_on_bits(lambda t1: own(2 * t1))
    assert diffrax._integrate.eqxi is eqxi
