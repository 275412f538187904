"""Small symmetric systems at every size that is solved in a way of its own, against NumPy."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from hybridsens.numerics.dense import LOOPED, UNROLLED, pivots, solve_masked, solve_spd
from tests.closeness import assert_close

SIZES = [1, 2, 3, UNROLLED, UNROLLED + 1, LOOPED, LOOPED + 1]


def system(n: int, condition: float):
    """A positive definite matrix of that condition number, and a right-hand side."""
    random = np.random.default_rng(n)
    directions = np.linalg.qr(random.normal(size=(n, n)))[0]
    return (directions * np.geomspace(1, 1 / condition, n)) @ directions.T, random.normal(size=n)


@pytest.mark.parametrize("n", SIZES)
def test_a_system_is_solved_to_what_its_condition_allows(n):
    for condition in (1e2, 1e8):
        A, b = system(n, condition)
        exact = np.linalg.solve(A, b)
        assert_close(solve_spd(jnp.array(A), jnp.array(b)), exact, 1e-15 * n * condition)
        columns = solve_spd(jnp.array(A), jnp.stack([jnp.array(b)] * 2, axis=1))
        assert_close(columns[:, 1], exact, 1e-15 * n * condition)


@pytest.mark.parametrize("n", [1, 2, UNROLLED, UNROLLED + 1, LOOPED + 1])
def test_derivatives_of_a_solve_are_solves(n):
    """First and second derivatives, forward over reverse, by both arguments."""
    A, b = map(jnp.array, system(n, 10.0))
    sums = lambda solve: lambda A, b: jnp.sum(jnp.sin(solve((A + A.T) / 2, b)))

    def derivatives(f):
        gradient = jax.grad(f, argnums=(0, 1))
        return gradient(A, b), jax.jvp(gradient, (A, b), (A @ A, b))[1]

    ours, plain = (derivatives(sums(solve)) for solve in (solve_spd, jnp.linalg.solve))
    for found, expected in zip(jax.tree.leaves(ours), jax.tree.leaves(plain), strict=True):
        assert_close(found, expected, 1e-11)


@pytest.mark.parametrize("n", SIZES)
def test_among_members_only_their_block_is_solved(n):
    """Nobody, some, all of them; what stands outside may be anything, also singular."""
    A, b = system(n, 10.0)
    for members in (np.zeros(n), np.arange(n) % 2, np.ones(n)):
        inside = members > 0
        given = np.where(np.outer(inside, inside), A, 1.0)
        expected = np.zeros(n)
        expected[inside] = np.linalg.solve(A[np.ix_(inside, inside)], b[inside])
        assert_close(
            solve_masked(jnp.array(given), jnp.array(b), jnp.array(members, float)), expected, 1e-13, scale=1.0
        )


@pytest.mark.parametrize("n", SIZES)
def test_pivots_tell_a_definite_matrix_from_others(n):
    A, _ = system(n, 10.0)
    shifted = A - 1.01 * np.linalg.eigvalsh(A)[0] * np.eye(n)
    assert bool(jnp.all(pivots(jnp.array(A)) > 0))
    assert not bool(jnp.all(pivots(jnp.array(shifted)) > 0))
