"""The complementarity problem behind Gauss's principle and the impact law, against trying every index set."""

import itertools

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from scipy.optimize import nnls

from hybridsens.mechanics.complementarity import complementarity_support, independent_superset
from hybridsens.mechanics.delassus import Delassus
from tests.closeness import assert_close

CONTACTS, DOF = 4, 3
TINY = 1e-9
support_of = jax.jit(complementarity_support)
larger_of = jax.jit(independent_superset)
solve_on = jax.jit(Delassus.solve)
FORMS = {
    "whole": lambda A: Delassus(jnp.array(A.T @ A), len(A)),
    "by factors": lambda A: Delassus(jnp.array(A.T), len(A), jnp.array(A)),
}
"""W = A^T A, A = M^-1/2 G, in both of its forms."""
in_both_forms = pytest.mark.parametrize("form", FORMS.values(), ids=FORMS)
# Small whole numbers make dependent and repeated contacts, and impulses that are exactly zero, common.
jacobians = arrays(float, (CONTACTS, DOF), elements=st.integers(-2, 2).map(float))
pushes = arrays(float, DOF, elements=st.integers(-3, 3).map(float))
choices = arrays(bool, CONTACTS)


def brute_force(W, b, candidates):
    """A solution of 0 <= x _|_ W x + b >= 0 on the candidates, from trying all index sets; W x is the same for all."""
    members = np.flatnonzero(candidates)
    for size in range(len(members) + 1):
        for chosen in itertools.combinations(members, size):
            x = np.zeros(CONTACTS)
            index = list(chosen)
            x[index] = np.linalg.lstsq(W[np.ix_(index, index)], -b[index], rcond=None)[0]
            residual = (W @ x + b)[members]
            if np.all(x >= -TINY) and np.all(residual >= -TINY) and np.all(np.abs((W @ x + b)[index]) <= TINY):
                return x
    raise AssertionError("every such problem with b in the range of G^T has a solution")


@in_both_forms
@settings(max_examples=150, deadline=None, derandomize=True)
@given(jacobians, pushes, choices)
def test_support_solves_the_problem(form, G, push, candidates):
    """W = G G^T may be singular (more contacts than coordinates); the motion that the impulses make is unique."""
    W, b = G @ G.T, G @ push
    S = np.asarray(support_of(form(G.T), jnp.array(b), jnp.array(candidates), jnp.full(CONTACTS, 1e-12)))
    assert not np.any(S & ~candidates)
    x = np.zeros(CONTACTS)
    x[S] = np.linalg.solve(W[np.ix_(S, S)], -b[S])
    assert np.all(x >= -TINY)
    assert np.all((W @ x + b)[candidates] >= -TINY)
    assert_close(G.T @ x, G.T @ brute_force(W, b, candidates), TINY, scale=10.0)


MANY = [(10, 3), (10, 12), (30, 3), (30, 12), (30, 40)]
"""Contacts and coordinates: redundant, about as many of each, more coordinates."""


def many_problems(contacts, dof, count=100):
    """Jacobians of small whole numbers, with rows repeated, and pushes; a third of the contacts is open."""
    random = np.random.default_rng(contacts + dof)
    for _ in range(count):
        G = random.integers(-2, 3, (contacts, dof)).astype(float)
        G[random.integers(contacts, size=contacts // 5)] = G[0]
        yield G, random.integers(1, 4, dof) * random.choice([-1.0, 1.0], dof), random.random(contacts) < 2 / 3


@in_both_forms
@pytest.mark.parametrize("spread", [0, 2, 3])
@pytest.mark.parametrize("contacts, dof", MANY)
def test_support_of_many_contacts_is_that_of_nonnegative_least_squares(form, contacts, dof, spread):
    """min |A x + push| over x >= 0, A = M^-1/2 G^T, has the same A x by SciPy; masses reach from 10^-spread to
    10^spread, a ratio of up to 1e6. The members stay independent."""
    masses = 10.0 ** np.linspace(-spread, spread, dof)
    for G, push, candidates in many_problems(contacts, dof):
        A = (G / np.sqrt(masses)).T
        b = A.T @ push
        noise = 1e-13 * np.linalg.norm(A, axis=0) * np.linalg.norm(push)
        S = np.asarray(support_of(form(A), *map(jnp.array, (b, candidates, noise))))
        assert not np.any(S & ~candidates)
        assert np.linalg.matrix_rank(A[:, S] / np.linalg.norm(A[:, S], axis=0)) == S.sum()
        x = np.zeros(contacts)
        x[S] = np.linalg.lstsq(A[:, S], -push)[0]
        expected = A[:, candidates] @ nnls(A[:, candidates], -push)[0]
        assert_close(A @ x, expected, 1e-7, scale=np.linalg.norm(push))


def least_motion(A, b):
    """The w of least length with A^T w + b >= 0, by non-negative least squares (Lawson and Hanson 1974, ch. 23); None
    where there is none."""
    columns, target = np.vstack([A, b]), np.append(np.zeros(len(A)), -1.0)
    rest = columns @ nnls(columns, target)[0] - target
    return None if rest[-1] < 1e-9 else rest[:-1] / rest[-1]


@in_both_forms
@pytest.mark.parametrize("contacts, dof", [(3, 1), (10, 1), (10, 2), (10, 3), (30, 3)])
def test_of_dependent_contacts_those_act_that_ask_for_most(form, contacts, dof):
    """Parallel walls of unequal restitution, or of unequal scales: b is none that a single motion makes."""
    random, solved = np.random.default_rng(contacts + dof), 0
    for G, push, candidates in many_problems(contacts, dof):
        A = np.abs(G.T) + np.eye(dof, contacts)
        b = random.uniform(1, 2, contacts) * (A.T @ push)
        expected = least_motion(A[:, candidates], b[candidates]) if candidates.any() else np.zeros(dof)
        if expected is None:
            continue
        S = np.asarray(support_of(form(A), *map(jnp.array, (b, candidates, np.full(contacts, 1e-11)))))
        w = np.linalg.lstsq(A[:, S].T, -b[S])[0]
        assert_close(w, expected, 1e-7, scale=max(1.0, np.linalg.norm(expected)))
        solved += 1
    assert solved > 30


@in_both_forms
@pytest.mark.parametrize("contacts, dof", MANY)
def test_as_many_contacts_are_added_as_are_independent(form, contacts, dof):
    """The larger set has the rank of all candidates, by singular values, and keeps what it was given."""
    for G, push, candidates in many_problems(contacts, dof, 30):
        W = form(G.T)
        S = support_of(W, jnp.array(G @ push), jnp.array(candidates), jnp.full(contacts, 1e-12))
        larger = np.asarray(larger_of(W, S, jnp.array(candidates)))
        assert np.all(larger[np.asarray(S)]) and not np.any(larger & ~candidates)
        assert larger.sum() == np.linalg.matrix_rank(G[larger]) == np.linalg.matrix_rank(G[candidates])


def two_contacts_and_a_third_that_is_none(count=2000):
    """Problems of two contacts, many of them dependent or untouched; and the same with one more that does not count."""
    draw = np.random.default_rng(0)
    G = draw.normal(size=(count, 2, 2))
    G[::5, 1] = draw.normal(size=(count // 5, 1)) * G[::5, 0]
    W = np.einsum("nij,nkj->nik", G, G)
    b = draw.normal(size=(count, 2)) * (draw.random((count, 2)) < 0.9)
    candidates, S = draw.random((count, 2)) < 0.8, np.eye(3, dtype=bool)[draw.integers(3, size=count)][:, :2]
    larger = np.tile(np.eye(3), (count, 1, 1))
    larger[:, :2, :2] = W
    beside = lambda entries: np.column_stack([entries, np.zeros(count, entries.dtype)])
    return (W, b, candidates, S), (larger, beside(b), beside(candidates), beside(S))


def test_two_contacts_are_treated_like_many():
    support = lambda W, *given: complementarity_support(Delassus(W, 2), *given)
    larger = lambda W, *given: independent_superset(Delassus(W, 2), *given)
    found = []
    for W, b, candidates, S in two_contacts_and_a_third_that_is_none():
        chosen = jax.vmap(support)(W, b, candidates, np.full_like(b, 1e-12))
        found.append((chosen[:, :2], jax.vmap(larger)(W, S, candidates)[:, :2]))
    for two, three in zip(*found, strict=True):
        assert np.array_equal(two, three)
        assert {tuple(row) for row in np.asarray(two).tolist()} == set(itertools.product([False, True], repeat=2))


def solved_by(form, G, S, b):
    """W x = sin(G_0) + b on the set S, with W = G G^T in one of its forms."""
    dof = G.shape[1]
    W = Delassus(G, dof, G.T) if form == "by factors" else Delassus(G @ G.T, dof)
    return W.solve(jnp.sin(G[:, 0]) + b, S)


each_by_jacobian = [
    jax.jit(derivative(solved_by, argnums=1), static_argnums=0) for derivative in (jax.jacfwd, jax.jacrev)
]


@pytest.mark.slow
@pytest.mark.parametrize("contacts, dof", [(30, 3), (30, 12)])
def test_both_forms_of_the_matrix_say_the_same(contacts, dof):
    """Diagonal, rows, products, what is coupled, solutions on a set, and derivatives of these by the jacobian."""
    for G, push, candidates in many_problems(contacts, dof, 10):
        whole, by_factors = (form(G.T) for form in FORMS.values())
        b, candidates = jnp.array(G @ push), jnp.array(candidates)
        S = larger_of(whole, jnp.zeros_like(candidates), candidates)
        assert_close(by_factors.diagonal(), whole.diagonal(), 1e-14, scale=1.0)
        assert_close(by_factors.row(2), whole.row(2), 1e-14, scale=1.0)
        assert_close(by_factors @ b, whole @ b, 1e-12, scale=1.0)
        assert by_factors.couples(S) == whole.couples(S)
        assert not by_factors.couples(S & (jnp.cumsum(S) == 1))
        x = np.asarray(solve_on(by_factors, b, S.astype(float)))
        assert_close((np.asarray(whole.rows) @ x)[S], b[S], 1e-12, scale=jnp.max(jnp.abs(b)))
        assert np.all(x[~np.asarray(S)] == 0)
        for by_jacobian in each_by_jacobian:
            found, expected = (by_jacobian(form, jnp.array(G), S.astype(float), b) for form in ("by factors", "whole"))
            assert_close(found, expected, 1e-9, scale=jnp.max(jnp.abs(expected)))
