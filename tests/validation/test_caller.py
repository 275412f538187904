"""A warning names the line of the user's program, however deep in the package or in JAX it is made."""

import linecache
import warnings

import equinox as eqx
import jax
import jax.numpy as jnp
import pytest

import hybridsens as hs
from hybridsens.scenes import BouncingBall


class Bumpy(BouncingBall):
    """A force with a kink."""

    def force(self, t, q, v):
        return super().force(t, q, v) - jnp.abs(v)


class Constant(hs.AbstractScene):
    """A number that is no parameter, beside one that is."""

    weight: jax.Array
    length: float

    def mass_matrix(self, q):
        return jnp.eye(1)

    def force(self, t, q, v):
        return -self.weight[None] * self.length

    def gap(self, t, q):
        return q

    def restitution(self):
        return jnp.ones(1)


def line_of(call) -> str:
    """The line that the one warning of a call names, in this file."""
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        call()
    assert {warning.filename for warning in caught} == {__file__}
    return linecache.getline(__file__, caught[0].lineno).strip()


def motion_of(scene):
    return hs.simulate(scene, hs.State([1.0], [0.0]), t1=0.1, throw=False).final.q[0]  # here


@pytest.mark.parametrize("ask", [motion_of, eqx.filter_jit(motion_of)], ids=["plain", "jit"])
def test_a_kink_is_told_of_where_the_motion_is_asked_for(ask):
    assert line_of(lambda: ask(Bumpy())).endswith("# here")


def test_what_a_gradient_misses_is_told_of_where_the_motion_is_asked_for():
    assert line_of(lambda: eqx.filter_grad(motion_of)(Constant(1.0, 2.0))).endswith("# here")


def test_a_class_with_a_name_that_nothing_reads_is_told_of_where_it_is_written():
    def write():
        class Misspelt(BouncingBall):  # the class
            def jump_time(self):
                return None

    assert line_of(write).endswith("# the class")
