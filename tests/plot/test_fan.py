"""The picture of a batch of motions, against quantiles of a closed form."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import hybridsens as hs

TS = jnp.linspace(0.0, 0.3, 4)
SPEEDS = jnp.linspace(0.0, 1.0, 21)


class Cart(hs.AbstractScene):
    """A mass that nothing moves, before a wall that is not reached."""

    coordinates = ("place [m]",)

    def mass_matrix(self, q):
        return jnp.eye(1)

    def force(self, t, q, v):
        return jnp.zeros(1)

    def gap(self, t, q):
        return 5.0 - q

    def restitution(self):
        return jnp.array([0.5])


def roll(speed, **settings):
    return hs.simulate(Cart(), hs.State(jnp.zeros(1), speed[None]), t1=0.3, throw=False, **settings)


@pytest.fixture(scope="module")
def batch():
    return jax.vmap(lambda speed: roll(speed, ts=TS))(SPEEDS)


def test_median_and_bands_are_quantiles(batch):
    """q = v t, with speeds from 0 to 1: the median is t / 2, nine of ten are from t / 20 to 19 t / 20."""
    (axes,) = hs.plot_fan(batch, Cart()).axes
    assert axes.get_ylabel() == "place [m]" and axes.get_title(loc="left") == "21 motions"
    np.testing.assert_allclose(axes.lines[0].get_ydata(), TS / 2, rtol=1e-12)
    heights = axes.collections[0].get_paths()[0].vertices
    at_end = heights[heights[:, 0] == heights[:, 0].max()][:, 1]
    np.testing.assert_allclose([at_end.min(), at_end.max()], [0.3 * 0.05, 0.3 * 0.95], rtol=1e-12)


def test_motions_that_failed_are_left_out_and_told(batch):
    """The fastest ones: the median is that of the others."""
    failed = jnp.where(SPEEDS > 0.525, hs.Status.max_steps_reached.code, hs.Status.successful.code)
    told = hs.plot_fan(type(batch)(**{**vars(batch), "status": hs.Status(failed)})).axes[0]
    assert told.get_title(loc="left") == "11 motions, 10 that failed left out" and told.get_ylabel() == "q[0]"
    np.testing.assert_allclose(told.lines[0].get_ydata(), TS / 4, rtol=1e-12)


def test_what_cannot_be_drawn_is_told(batch, unchecked):
    with pytest.raises(ValueError, match=r"batch of one axis with samples, but `ts` has the shape \(4,\)"):
        hs.plot_fan(batch[0])
    with pytest.raises(ValueError, match=r"draw one of them, `trajectory\[0\]`.*`plot_fan\(trajectory\)`"):
        hs.plot_coordinates(Cart(), batch)
    with pytest.raises(TypeError, match="must be a batch of motions"):
        hs.plot_fan(Cart())
    apart = jax.vmap(lambda speed: roll(speed, ts=TS * speed))(SPEEDS[1:])
    with pytest.raises(ValueError, match="their `ts` differ"):
        hs.plot_fan(apart)


class Decay(hs.AbstractHybridSystem):
    """A level that falls, beside a pair of numbers that stays."""

    rate: jax.Array

    def flow(self, t, x, mode):
        return {"level": -self.rate * x["level"], "pair": jnp.zeros(2)}

    def guards(self, t, x, mode):
        return jnp.zeros(0)

    def transition(self, event, t, x, mode):
        return x, mode


def test_a_system_has_a_row_for_each_entry_of_its_state():
    """The median of exp(-k t) is that of the median of k."""
    start = {"level": jnp.array(1.0), "pair": jnp.array([2.0, 3.0])}
    batch = jax.vmap(lambda rate: hs.solve(Decay(rate), start, t1=0.3, ts=TS))(SPEEDS)
    level, *pair = hs.plot_fan(batch).axes
    np.testing.assert_allclose(level.lines[0].get_ydata(), np.exp(-TS / 2), rtol=1e-7)
    assert [axes.get_ylabel() for axes in (level, *pair)] == ["x.level", "x.pair[0]", "x.pair[1]"]
    np.testing.assert_allclose(pair[1].lines[0].get_ydata(), 3.0)
