"""Mass matrices as arrays and as operators: one motion and one gradient, whatever is known of the matrix."""

import functools

import equinox as eqx
import jax
import jax.numpy as jnp
import lineax as lx
import pytest

import hybridsens as hs
from hybridsens.mechanics.mass import KnownMass, is_positive_definite, solve_mass, with_known_mass
from tests.closeness import assert_close

DOF = 6
FORMS = ["diagonal", "tridiagonal", "dense", "tagged", "identity", "eye", "depends on q"]
DIAGONAL_ARRAYS = ["diagonal array", "diagonal by q"]


class Row(hs.AbstractScene):
    """Coupled bodies above a floor; what the mass matrix is given as differs, what it is does not."""

    m: jax.Array
    coupling: jax.Array
    form: str = eqx.field(static=True)

    def mass_matrix(self, q):
        m, side = self.m, jnp.broadcast_to(self.coupling, (DOF - 1,))
        dense = jnp.diag(m) + jnp.diag(side, 1) + jnp.diag(side, -1)
        return {
            "diagonal": lx.DiagonalLinearOperator(m),
            "tridiagonal": lx.TridiagonalLinearOperator(m, side, side),
            "dense": dense,
            "tagged": lx.MatrixLinearOperator(dense, lx.positive_semidefinite_tag),
            "identity": lx.IdentityLinearOperator(jax.ShapeDtypeStruct((DOF,), q.dtype)),
            "eye": jnp.eye(DOF),
            "diagonal array": jnp.diag(m),
            "diagonal by q": jnp.eye(DOF) * (m + 0 * q[0]),
            "depends on q": dense + jnp.diag(0 * q),
        }[self.form]

    def force(self, t, q, v):
        return -self.m * (9.81 + jnp.arange(DOF) * jnp.sin(3 * t))

    def gap(self, t, q):
        return q[:1]

    def restitution(self):
        return jnp.array([0.7])


M, COUPLING, B = 1 + 0.1 * jnp.arange(DOF), jnp.array(0.3), jnp.cos(jnp.arange(DOF))


def as_array(form: str, m, coupling):
    """The matrix that a form stands for."""
    if form in ("identity", "eye"):
        return jnp.eye(DOF)
    side = 0 if form.startswith("diagonal") else coupling
    return jnp.diag(m) + side * (jnp.eye(DOF, k=1) + jnp.eye(DOF, k=-1))


@pytest.mark.parametrize("form", FORMS + DIAGONAL_ARRAYS)
def test_a_mass_matrix_is_solved_as_what_it_is(form):
    """M^-1 b and its first and second derivatives by b and by what M is made of are those of a dense solve."""
    ours = lambda m, c, b: jnp.sum(jnp.sin(solve_mass(with_known_mass(Row(m, c, form), b).mass_matrix(b), b)))
    plain = lambda m, c, b: jnp.sum(jnp.sin(jnp.linalg.solve(as_array(form, m, c), b)))

    @functools.partial(jax.jit, static_argnums=0)
    def derivatives(f, *x):
        gradient = jax.grad(f, argnums=(0, 1, 2))
        return f(*x), gradient(*x), jax.jvp(gradient, x, (jnp.sin(M), jnp.array(1.0), M))[1]

    found, expected = derivatives(ours, M, COUPLING, B), derivatives(plain, M, COUPLING, B)
    for one, other in zip(jax.tree.leaves(found), jax.tree.leaves(expected), strict=True):
        assert_close(one, other, 1e-13, scale=1.0)


def test_what_a_trace_tells_of_a_mass_matrix():
    """An identity, a diagonal and a constant are seen as such; what else depends on q is left alone, and an operator
    too."""
    known = lambda form: with_known_mass(Row(M, COUPLING, form), B)
    form = lambda name: known(name).form if isinstance(known(name), KnownMass) else None
    assert form("eye") == "identity" and form("dense") == "dense" and form("tagged") == "dense"
    assert {form(name) for name in DIAGONAL_ARRAYS} == {"diagonal"}
    assert {form(name) for name in ("depends on q", "diagonal", "tridiagonal", "identity")} == {None}


@jax.custom_jvp
def straight_through(c):
    """0, with the derivative of c."""
    return 0 * c


straight_through.defjvp(lambda primals, tangents: (0 * primals[0], tangents[0]))


class Coupled(Row):
    """A mass matrix whose coupling is 0, or seems to be."""

    def mass_matrix(self, q):
        side = {
            "rule": straight_through,
            "threshold": lambda c: jnp.maximum(c - 1e20, 0),
            "zero": lambda c: 0 * c,
            "relu": lambda c: 0 * jax.nn.relu(c),
        }[self.form](self.coupling)
        return jnp.diag(self.m.astype(q.dtype)) + side.astype(q.dtype) * (1 - jnp.eye(DOF, dtype=q.dtype))


@pytest.mark.parametrize("dtype", [jnp.float32, jnp.float64])
def test_what_is_zero_for_some_values_alone_is_not_left_out(dtype):
    """Beyond a threshold, or where a rule written by hand gives it a derivative."""
    of = lambda form: with_known_mass(Coupled(M.astype(dtype), COUPLING.astype(dtype), form), B.astype(dtype))
    kept = lambda form: isinstance(of(form), KnownMass) and of(form).form
    assert {name: kept(name) for name in ("zero", "relu")} == dict.fromkeys(("zero", "relu"), "diagonal")
    assert kept("rule") != "diagonal" and kept("threshold") != "diagonal"


@pytest.mark.slow
def test_a_motion_is_the_same_with_any_form_of_its_mass():
    """State and gradient: by a band, and by an inverse that is known before the motion begins."""

    @functools.partial(jax.jit, static_argnums=2)
    def energy(m, coupling, form):
        start = hs.State(1 + 0.1 * jnp.arange(DOF), jnp.zeros(DOF))
        final = hs.simulate(Row(m, coupling, form), start, t1=0.8, max_steps=256, max_events=8, throw=False).final
        return jnp.sum(final.q**2) + jnp.sum(final.v)

    found = [jax.value_and_grad(energy, argnums=(0, 1))(M, COUPLING, form) for form in ("tridiagonal", "dense")]
    for a, b in zip(*map(jax.tree.leaves, found), strict=True):
        assert_close(a, b, 1e-9)


@pytest.mark.parametrize("side", [(0.3, 0.2), (5.0, 5.0), (jnp.nan, jnp.nan)])
def test_a_band_that_is_no_mass_matrix_is_told(side):
    """One that is not symmetric, one that is not definite, one that is not a number."""
    below, above = (jnp.full(DOF - 1, x) for x in side)
    assert not is_positive_definite(lx.TridiagonalLinearOperator(M, below, above))
    assert is_positive_definite(lx.TridiagonalLinearOperator(M, below * 0 + 0.3, below * 0 + 0.3)) != jnp.isnan(side[0])


class Unfit(Row):
    """Its mass is an operator of another size than q."""

    def mass_matrix(self, q):
        return lx.DiagonalLinearOperator(jnp.ones(4))


def test_an_operator_must_fit_the_state():
    """Its size is that of q."""
    with pytest.raises(ValueError, match=r"`mass_matrix` must return an array of shape \(6, 6\)"):
        hs.simulate(Unfit(M, COUPLING, "diagonal"), hs.State(jnp.ones(DOF), jnp.zeros(DOF)), t1=1.0)
