"""A sweep on several worker processes, one of which is killed."""

import os
import signal
import threading
import time

import jax.numpy as jnp
import numpy as np
import pytest

from hybridsens.sweeps import grid, sweep

distributed = pytest.importorskip("dask.distributed")
pytestmark = pytest.mark.filterwarnings("ignore")  # dask warns about ports and slow imports of its workers


def make_cost():
    """Made inside a function, so that workers get it by value and need not find this file."""
    import jax

    def cost(scene):
        return scene["a"] * scene["b"] ** 2 * jax.lax.fori_loop(0, 3_000_000, lambda i, x: x * 0.5 + 0.5, 1.0)

    return cost


@pytest.mark.slow
def test_a_killed_workers_chunks_run_again_elsewhere(tmp_path):
    """Assert that every point is there and right, at double precision, though a worker was killed in the middle."""
    axis = np.linspace(1.0, 2.0, 12)
    design = grid({"a": jnp.array(1.0), "b": jnp.array(1.0)}, {"a": axis, "b": axis})
    store = tmp_path / "sweep.zarr"
    killed = []

    def kill_one(pids):
        while not any(store.glob("status/c/*/*")):
            time.sleep(0.005)
        os.kill(pids[0], signal.SIGKILL)
        killed.append(len(list(store.glob("status/c/*/*"))))

    with distributed.LocalCluster(n_workers=2, threads_per_worker=1, processes=True, dashboard_address=None) as cluster:
        with distributed.Client(cluster) as client:
            pids = list(client.run(os.getpid).values())
            assassin = threading.Thread(target=kill_one, args=(pids,))
            assassin.start()
            found = sweep(make_cost(), design, chunk=12, store=store, client=client, gradient=["b"], progress=False)
            assassin.join()
    assert killed[0] < 12, "the worker was killed after the sweep"
    a, b = np.meshgrid(axis, axis, indexing="ij")
    np.testing.assert_allclose(found.J, a * b**2, rtol=1e-14)
    np.testing.assert_allclose(found.dJ_db, 2 * a * b, rtol=1e-14)
