"""The complementarity problem behind Gauss's principle and the impact law, against trying every index set."""

import itertools

import jax
import jax.numpy as jnp
import numpy as np
from closeness import assert_close
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from hybridsens.mechanics.complementarity import complementarity_support

CONTACTS, DOF = 4, 3
TINY = 1e-9
support_of = jax.jit(complementarity_support)
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


@settings(max_examples=150, deadline=None, derandomize=True)
@given(jacobians, pushes, choices)
def test_support_solves_the_problem(G, push, candidates):
    """W = G G^T may be singular (more contacts than coordinates); the motion that the impulses make is unique."""
    W, b = G @ G.T, G @ push
    S = np.asarray(support_of(jnp.array(W), jnp.array(b), jnp.array(candidates), jnp.full(CONTACTS, 1e-12)))
    assert not np.any(S & ~candidates)
    x = np.zeros(CONTACTS)
    x[S] = np.linalg.solve(W[np.ix_(S, S)], -b[S])
    assert np.all(x >= -TINY)
    assert np.all((W @ x + b)[candidates] >= -TINY)
    assert_close(G.T @ x, G.T @ brute_force(W, b, candidates), TINY, scale=10.0)
