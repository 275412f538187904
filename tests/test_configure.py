"""What `configure` sets besides JAX's own settings."""

import subprocess
import sys

import pytest

FAULTS = """
import resource

import hybridsens as hs

if {configured}:
    hs.configure()
import jax

jax.config.update("jax_enable_x64", True)
ball = hs.scenes.BouncingBall()
fly = jax.jit(lambda s: hs.simulate(s, s.initial_state(), t1=1.0, max_steps=300_000, throw=False).final.q)
faults = lambda: resource.getrusage(resource.RUSAGE_SELF).ru_minflt
for _ in range(5):
    fly(ball).block_until_ready()
before = faults()
for _ in range(50):
    fly(ball).block_until_ready()
print((faults() - before) / 50)
"""


@pytest.mark.skipif(sys.platform != "linux", reason="the C library of Linux alone is told so")
def test_a_long_record_is_not_fetched_anew_at_every_call():
    """Its 7 MB are as many pages as the system takes back after each call, where it is not told otherwise: 300."""
    faults = {
        configured: float(
            subprocess.run(
                [sys.executable, "-c", FAULTS.format(configured=configured)], capture_output=True, text=True, check=True
            ).stdout
        )
        for configured in (False, True)
    }
    assert faults[True] < 20 < faults[False]
