"""The Delassus matrix W = G^T M^-1 G: how an impulse at one contact changes the rates of all."""

from typing import Any

import equinox as eqx
import jax.numpy as jnp
from jax import lax
from jaxtyping import Array, Bool, Float

from ..numerics.dense import linear_solve, pivoted_on, principal_pivot, solve_masked
from ..numerics.tolerances import closeness


class Delassus(eqx.Module):
    """W of n contacts: all of it, or its factors G^T and M^-1 G where there are many more contacts than coordinates.

    A thousand walls around a body of two coordinates have a W of a million entries and of rank two. By its factors a
    pivot of the tableau (W, b) costs O(n dof) in place of O(n^2), and nothing of size n^2 is ever made: the rows of the
    tableau are kept as what is multiplied by M^-1 G. (The columns of pivoted contacts are not rows of that kind. They
    are never asked for, since no contact is pivoted out again.)
    """

    rows: Float[Array, "contact columns"]
    """W itself, or G^T."""
    dof: int = eqx.field(static=True)
    """How many coordinates there are: no more contacts than that can be independent."""
    mobility: Float[Array, "dof contact"] | None = None
    """M^-1 G, where the rows are those of G^T."""

    def diagonal(self) -> Float[Array, "contact"]:
        """W_ii of each contact [1/kg]."""
        return self.left(self.rows)

    def row(self, k) -> Float[Array, "contact"]:
        """The rates that a unit impulse at contact k makes."""
        return self.rows[k] if self.mobility is None else self.rows[k] @ self.mobility

    def __matmul__(self, impulse: Float[Array, "contact"]) -> Float[Array, "contact"]:
        """The rates that impulses make."""
        return self.rows @ (impulse if self.mobility is None else self.mobility @ impulse)

    def sizes(self, impulse: Float[Array, "contact"]) -> Float[Array, "contact"]:
        """What the terms of these rates add up to, without their signs."""
        size = jnp.abs(impulse)
        return jnp.abs(self.rows) @ (size if self.mobility is None else jnp.abs(self.mobility) @ size)

    def solve(self, right: Float[Array, "contact"], members: Float[Array, "contact"]) -> Float[Array, "contact"]:
        """x with W_SS x_S = right_S and x = 0 outside S, where `members` is 1 in S and 0 outside."""
        if self.mobility is None:
            return solve_masked(self.rows, right, members)
        product = lambda W, x: members * (W @ (members * x)) + (1 - members) * x
        W = lax.stop_gradient(self)
        eliminated = lambda b: jnp.where(members > 0, W.pivoted_on(W.tableau(-b), members > 0)[:, -1], b)
        # Twice: once for what the first elimination leaves, which makes it as exact as factors are.
        twice = lambda b: lax.fori_loop(0, 2, lambda _, x: x + eliminated(b - product(W, x)), jnp.zeros_like(b))
        return linear_solve(lambda x: product(self, x), right * members, twice)

    def tableau(self, b: Any) -> Float[Array, "contact columns"]:
        """The relations y = (W, b) (x, 1), before any pivot."""
        return jnp.column_stack([self.rows, b])

    def left(self, tableau) -> Float[Array, "contact"]:
        """Of contacts that were not pivoted on: what is left of W_ii when those that were are eliminated."""
        if self.mobility is None:
            return jnp.diagonal(tableau)
        return jnp.sum(tableau[:, : self.mobility.shape[0]] * self.mobility.T, axis=1)

    def column(self, tableau, k) -> Float[Array, "contact"]:
        """What the pivoted relations say of a contact k that was not pivoted on: of each by k's impulse."""
        if self.mobility is None:
            return tableau[:, k]
        return tableau[:, : self.mobility.shape[0]] @ self.mobility[:, k]

    def independent(self, tableau, pivoted: Bool[Array, "contact"]) -> Bool[Array, "contact"]:
        """Contacts of which the tableau leaves something: their columns do not depend on those that were pivoted on."""
        some_left = self.left(tableau) > closeness(tableau.dtype) * self.diagonal()
        return some_left & (jnp.sum(pivoted) < self.dof)

    def pivot(self, tableau, k) -> Float[Array, "contact columns"]:
        """The tableau after a principal pivot on contact k."""
        if self.mobility is None:
            return principal_pivot(tableau, k)
        column = self.column(tableau, k)
        row = tableau[k] / -column[k]
        here = jnp.arange(tableau.shape[0]) == k
        return jnp.where(here[:, None], row, tableau + column[:, None] * row)

    def pivoted_on(self, tableau, members: Bool[Array, "contact"]) -> Float[Array, "contact columns"]:
        """The tableau after a principal pivot on each member."""
        return pivoted_on(tableau, members, self.pivot)

    def couples(self, members: Bool[Array, "contact"]) -> Bool[Array, ""]:
        """Whether an impulse at one of the members changes the rate of another one."""
        diagonal, places = jnp.abs(self.diagonal()), jnp.arange(members.shape[0])
        by = lambda row, W_kk: jnp.abs(row) > closeness(row.dtype) * jnp.sqrt(W_kk * diagonal)
        if self.mobility is None:
            pairs = members[:, None] & members & by(self.rows, diagonal[:, None])
            return jnp.any(pairs & ~jnp.eye(members.shape[0], dtype=bool))

        def look(carry):
            left, _ = carry
            k = jnp.argmax(left)
            left = left & (places != k)
            return left, jnp.any(left & by(self.row(k), diagonal[k]))

        more = lambda carry: jnp.any(carry[0]) & ~carry[1]
        return lax.while_loop(more, look, (members, jnp.array(False)))[1]
