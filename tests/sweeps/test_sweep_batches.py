"""How many points one compiled program takes at once."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from hybridsens.sweeps import engine as engine_module
from hybridsens.sweeps import grid, random, sweep


def test_a_batch_too_large_for_memory_is_halved(monkeypatch):
    """Assert that a device which only takes 8 lanes at once gives every point all the same, with a word."""
    run, seen = engine_module._run, []

    def small(program, columns, count, mesh, mapped):
        seen.append(len(columns["a"]))
        if seen[-1] > 8:
            raise jax.errors.JaxRuntimeError("RESOURCE_EXHAUSTED: Out of memory allocating 1 bytes.")
        return run(program, columns, count, mesh, mapped)

    monkeypatch.setattr(engine_module, "_run", small)
    design = random({"a": jnp.array(1.0)}, {"a": (0.0, 1.0)}, 45)
    with pytest.warns(UserWarning, match="do not fit into memory"):
        found = sweep(lambda s: s["a"] ** 2, design, progress=False, chunk=30)
    np.testing.assert_allclose(found.J, design.columns["a"] ** 2, rtol=1e-15)
    assert seen[:4] == [64, 32, 16, 8] and set(seen[4:]) == {8}


def test_another_number_of_points_compiles_nothing():
    """Assert that one program serves 3, 5 and 60 points, and gives each its own value."""
    compiled = engine_module._run._cached._cache_size
    cost, before = lambda s: s["a"] ** 2, compiled()
    for count in (3, 5, 60):
        values = np.linspace(1.0, 2.0, count)
        found = sweep(cost, grid({"a": jnp.array(1.0)}, {"a": values}), progress=False)
        np.testing.assert_allclose(found.J, values**2, rtol=1e-15)
        np.testing.assert_allclose(found.dJ_da, 2 * values, rtol=1e-15)
    assert compiled() == before + 1
