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
fly = jax.jit(lambda s: hs.simulate(s, s.initial_state(), t1=1.0, max_steps=2_000_000, throw=False).final.q)
faults = lambda: resource.getrusage(resource.RUSAGE_SELF).ru_minflt


def a_call_takes():
    # Over ten of them.
    before = faults()
    for _ in range(10):
        fly(ball).block_until_ready()
    return (faults() - before) / 10


print(min(a_call_takes() for _ in range(6)))  # the first ones fetch what is kept afterwards
"""


@pytest.mark.slow
@pytest.mark.skipif(sys.platform != "linux", reason="the C library of Linux alone is told so")
def test_a_long_record_is_not_fetched_anew_at_every_call():
    """Its 45 MB are 12,000 pages that the system takes back after each call, where it is not told otherwise."""
    faults = {
        configured: float(
            subprocess.run(
                [sys.executable, "-c", FAULTS.format(configured=configured)], capture_output=True, text=True, check=True
            ).stdout
        )
        for configured in (False, True)
    }
    assert faults[True] < 20 < faults[False]
