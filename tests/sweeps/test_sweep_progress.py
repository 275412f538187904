"""What a sweep shows at its end."""

import jax.numpy as jnp

import hybridsens as hs
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
