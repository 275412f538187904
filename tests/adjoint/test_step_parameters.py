"""Steps carry back the parameters that the flow depends on, and no others; tracing tells, nothing is compiled."""

import jax
import jax.numpy as jnp
import pytest
from jax import lax

import hybridsens as hs
from hybridsens import passes
from hybridsens.adjoint.step import step_parameter_mask


class Hidden(hs.AbstractScene):
    """Parameters behind a branch, in a loop, in a force that cancels from the trace, in the gap, nowhere."""

    branch: jax.Array
    loop: jax.Array
    unused_branch: jax.Array
    wall: jax.Array
    nowhere: jax.Array
    sustained_contact = False
    known_discontinuities = True  # the branch

    def mass_matrix(self, q):
        return jnp.eye(1)

    def force(self, t, q, v):
        pushed = lax.cond(q[0] > 0, lambda: self.branch, lambda: 0 * self.branch)
        slowed = lax.fori_loop(0, 2, lambda k, total: total - self.loop * v[0], 0.0)
        lax.cond(q[0] > 0, lambda: self.unused_branch, lambda: 0 * self.unused_branch)
        return jnp.stack([pushed + slowed])

    def gap(self, t, q):
        return self.wall - q

    def restitution(self):
        return jnp.array([0.5])


STOP, BALL = hs.scenes.ElasticStop(), hs.scenes.BouncingBall()
HIDDEN = Hidden(*jnp.ones((5,)))


@pytest.mark.parametrize(
    "scene, inside",
    [
        (STOP, {"mass", "stiffness", "damping", "amplitude", "frequency"}),
        (BALL, {"mass", "weight", "floor"}),  # a held contact is projected onto the floor
        (HIDDEN, {"branch", "loop"}),
    ],
    ids=lambda given: type(given).__name__,
)
def test_steps_know_the_parameters_of_the_flow(scene, inside, monkeypatch):
    told = []
    listen = lambda *given: told.append(step_parameter_mask(*given)) or told[-1]
    monkeypatch.setattr(passes, "step_parameter_mask", listen)
    start = hs.State([0.0], [1.0])
    cost = lambda scene: hs.simulate(scene, start, t1=1.0, throw=False).final.q[0]
    jax.eval_shape(jax.grad(cost), jax.tree.map(jnp.asarray, scene))
    leaves = jax.tree_util.tree_leaves_with_path(told[0].system.scene)
    assert {path[-1].name for path, needed in leaves if needed} == inside
