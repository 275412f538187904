"""What a gradient method does not serve is refused by the name of the one that does."""

import jax
import jax.numpy as jnp
import optimistix
import pytest

import hybridsens as hs

W = jnp.array(9.81)


class Stone(hs.AbstractScene):
    """A body in free fall: nothing to meet, quick to compile."""

    weight: jax.Array

    def mass_matrix(self, q):
        return jnp.eye(1)

    def force(self, t, q, v):
        return -self.weight[None]

    def gap(self, t, q):
        return jnp.zeros(0)

    def restitution(self):
        return jnp.zeros(0)


def final(weight, **settings):
    settings = dict(t1=0.1, max_events=1, max_steps=20) | settings
    return hs.simulate(Stone(weight), hs.State([1.0], [0.0]), **settings).final.q[0]


def forward(weight):
    return final(weight, adjoint=hs.ForwardSensitivities())


FORWARD = {
    "jvp": lambda: jax.jvp(final, (W,), (W,)),
    "jvp of jit": lambda: jax.jvp(jax.jit(final), (W,), (W,)),
    "jit of jvp": lambda: jax.jit(lambda w: jax.jvp(final, (w,), (w,)))(W),
    "jacfwd": lambda: jax.jacfwd(final)(W),
    "jit of jacfwd of jit": lambda: jax.jit(jax.jacfwd(jax.jit(final)))(W),
    "linearize": lambda: jax.linearize(final, W)[1](W),
    "vmap of jvp": lambda: jax.vmap(lambda w: jax.jvp(final, (w,), (w,)))(W[None]),
}


@pytest.mark.parametrize("way", FORWARD)
def test_forward_mode_without_forward_sensitivities(way):
    """Under jit and vmap too."""
    with pytest.raises(TypeError, match=r"adjoint=hybridsens.ForwardSensitivities\(\)"):
        FORWARD[way]()


REVERSE = {
    "grad": lambda: jax.grad(forward)(W),
    "jit of grad of jit": lambda: jax.jit(jax.grad(jax.jit(forward)))(W),
    "hessian": lambda: jax.hessian(forward)(W),
    "linear_transpose of jvp": lambda: jax.linear_transpose(lambda d: jax.jvp(forward, (W,), (d,))[1], W)(W),
    "linear_transpose": lambda: jax.linear_transpose(forward, W)(W),
}


@pytest.mark.parametrize("way", REVERSE)
def test_reverse_mode_with_forward_sensitivities(way):
    """What serves gradients and second derivatives is named."""
    with pytest.raises(TypeError, match=r"adjoint=hybridsens.Replay\(\).*jax.jacfwd\(jax.grad"):
        REVERSE[way]()


def weight_to_fall(height, adjoint):
    """The weight that falls from 1 to this height within 0.1: 200 (1 - height)."""
    miss = lambda weight, height: final(weight, adjoint=adjoint, throw=False) - height
    return optimistix.root_find(miss, optimistix.Newton(rtol=1e-10, atol=1e-10), W, height).value


@pytest.mark.parametrize("adjoint", [hs.Replay(), hs.ForwardSensitivities()], ids=["reverse", "forward"])
def test_a_root_in_reverse_mode(adjoint):
    """Neither method serves implicit differentiation in reverse mode; the words name what does."""
    with pytest.raises(TypeError, match=r"then transposed: adjoint=hybridsens.AnyMode\(\) serves that"):
        jax.grad(weight_to_fall)(jnp.array(0.9), adjoint)


@pytest.mark.parametrize("derivative", [jax.grad, pytest.param(jax.jacfwd, marks=pytest.mark.slow)])
def test_a_root_in_any_mode(derivative):
    """The way that the words name."""
    assert abs(derivative(weight_to_fall)(jnp.array(0.9), hs.AnyMode()) + 200) < 1e-6


@pytest.mark.parametrize("transform", [lambda f: f, jax.jit], ids=["plain", "jit"])
def test_reverse_mode_over_reverse_mode(transform):
    """Second derivatives are forward over reverse."""
    with pytest.raises(TypeError, match=r"use jax.jacfwd\(jax.grad\(...\)\) or jax.hessian"):
        transform(jax.grad(jax.grad(final)))(W)


@pytest.mark.parametrize("name", ["rtol", "atol", "max_step", "capture_speed"])
def test_settings_are_not_differentiated_by(name):
    """In both modes; a value that is held constant is let in."""
    with pytest.raises(TypeError, match="`rtol`, `atol`, `max_step` and `capture_speed` must not be differentiated by"):
        jax.grad(lambda x: final(W, **{name: x}))(jnp.array(1e-3))
    with pytest.raises(TypeError, match="must not be differentiated by"):
        move = lambda x: final(W, **{name: x}, adjoint=hs.ForwardSensitivities())
        jax.jvp(move, (jnp.array(1e-3),), (jnp.array(1.0),))


@pytest.mark.slow
def test_what_is_served_passes():
    """Gradients through vmap, scan, cond and checkpoint, and second derivatives, are those of free fall."""
    height, grad, expected = final, jax.grad, -0.005
    served = [
        grad(height)(W),
        grad(lambda w: jnp.sum(jax.vmap(height)(w[None])))(W),
        grad(lambda w: jax.lax.scan(lambda s, _: (s + height(w), None), 0.0, length=2)[0] / 2)(W),
        jax.vmap(grad(lambda w: jax.lax.cond(w > 0, height, lambda w: w, w)))(jnp.array([W, -1.0]))[0],
        grad(jax.checkpoint(height))(W),
        jax.linearize(forward, W)[1](1.0),
    ]
    assert jnp.allclose(jnp.array(served), expected, rtol=1e-9)
    second = [jax.hessian(height)(W), jax.jit(jax.jacfwd(grad(height)))(W), jax.jacfwd(jax.jacfwd(forward))(W)]
    assert jnp.all(jnp.abs(jnp.array(second)) < 1e-12)
