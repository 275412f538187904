"""What a sweep shows at its end, and what it has where Ctrl-C ended it."""

import jax.numpy as jnp
import numpy as np
import pytest

import hybridsens as hs
import hybridsens.sweeps.store as store_module
from tests.problems.balls import RestlessBall


def final_height(ball):
    motion = hs.simulate(ball, hs.State([1.0], [0.0]), t1=1.0, max_events=8, max_steps=64, throw=False)
    return motion.final.q[0], motion


def test_the_summary_tells_how_many_events_there_were(capsys):
    """A ball that is heavy enough strikes twice within a second, a light one not at all."""
    points = hs.grid(RestlessBall(jnp.array(1.0), jnp.array(0.5)), {"weight": [1.0, 9.0]})
    hs.sweep(final_height, points, gradient=False)
    told = capsys.readouterr().out
    assert "2 points, of 0 to 2 events" in told and "successful" in told
    hs.sweep(lambda ball: ball.weight**2, points)
    assert "events" not in capsys.readouterr().out


@pytest.mark.parametrize("stored", [True, False])
def test_a_sweep_that_is_interrupted_while_it_writes_has_a_status_beside_each_value(stored, tmp_path, monkeypatch):
    """Ctrl-C came between the values of a chunk and its statuses: these points had values, and no status."""
    write, calls = store_module.write_tile, []

    def interrupted(arrays, tile, results):
        calls.append(tile)
        if len(calls) == 2:
            arrays["J"][tuple(tile.values())] = results["J"]
            raise KeyboardInterrupt
        write(arrays, tile, results)

    monkeypatch.setattr(store_module, "write_tile", interrupted)
    points = hs.grid(RestlessBall(jnp.array(1.0), jnp.array(0.5)), {"weight": np.arange(1.0, 7.0)})
    store = tmp_path / "sweep.zarr" if stored else None
    found = hs.sweep(lambda ball: ball.weight**2, points, chunk=2, store=store, progress=False)
    assert "interrupted" in found.attrs
    np.testing.assert_array_equal(found.status != -1, [True] * 4 + [False] * 2)
    np.testing.assert_array_equal(np.isfinite(found.J), found.status != -1)
