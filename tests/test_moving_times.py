"""Scheduled times that do not stand still are told of."""

import equinox as eqx
import jax
import jax.numpy as jnp
import pytest

import hybridsens as hs


class Falling(hs.AbstractHybridSystem):
    """h'' = -1, and an event is scheduled for the time h, or its mirror image 2 - h. A guard of time may come
    before it. Each event brings h to rest again."""

    alarm: jax.Array
    side: int = eqx.field(default=1, static=True)

    def flow(self, t, x, mode):
        return {"h": x["v"], "v": jnp.array(-1.0)}

    def guards(self, t, x, mode):
        return (self.alarm - t)[None]

    def scheduled_times(self, x, mode):
        return (x["h"] if self.side > 0 else 2 - x["h"])[None]

    def transition(self, event, t, x, mode):
        return {"h": x["h"] + 2, "v": 0 * x["v"]}, mode


MOVES = {
    "before it comes": (Falling(jnp.array(9.0)), 1.0, None),
    "before another event": (Falling(jnp.array(0.5)), 1.0, None),
    "before a jump time": (Falling(jnp.array(9.0)), 1.0, [0.5]),
    "and would come before the end": (Falling(jnp.array(9.0)), 2.5, None),
    "away": (Falling(jnp.array(9.0), side=-1), 0.5, None),
}
SLOW = ("before it comes", "before another event", "before a jump time", "and would come before the end")
NAMES = [pytest.param(name, marks=pytest.mark.slow) if name in SLOW else name for name in MOVES]


@pytest.mark.parametrize("name", NAMES)
def test_a_time_that_moves_from_rest_is_told(name):
    """Its rate is 0 at the start: h = h0 - t^2 / 2 is met at t = sqrt(1 + 2 h0) - 1, not at h0."""
    system, h0, jumps = MOVES[name]
    jumps = None if jumps is None else jnp.array(jumps)
    solved = lambda h0, v0: hs.solve(system, {"h": h0, "v": v0}, t1=1.8, jump_ts=jumps, max_events=8, throw=False)
    moves = hs.Status.scheduled_time_moves
    assert solved(h0, 0.0).status == moves
    assert jax.vmap(solved, (None, 0))(h0, jnp.zeros(2)).status.code.tolist() == 2 * [moves.code]
