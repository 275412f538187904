"""A value and its derivative by one program, in the mode that a gradient method serves."""

import jax


def value_and_jacobian(function, adjoint):
    """p -> function(p, adjoint), and its derivative there."""
    way = jax.jacfwd if adjoint.forward_mode and not adjoint.reverse_mode else jax.jacrev

    def twice(p):
        value = function(p, adjoint)
        return value, value

    return lambda p: way(twice, has_aux=True)(p)[::-1]
