"""Why a row of a table failed, in a line."""

import equinox as eqx
import jax
import jax.numpy as jnp
import pytest

from hybridsens.comparison.measure import LONGEST, reason


def test_an_error_of_python_is_told_by_its_type_and_first_line():
    assert reason(ValueError("`x` must be there.\nIt is not.")) == "ValueError: `x` must be there."
    assert reason(ValueError()) == "ValueError: no message"
    assert len(reason(ValueError("long " * 100))) == len("ValueError: ") + LONGEST


def test_what_a_compiled_program_raised_is_told_and_not_how_its_traceback_begins():
    """As of an own solver inside the cost that does not converge."""

    @jax.jit
    def failing(x):
        return eqx.error_if(x, x > 0, "The solver found no root.")

    with pytest.raises(Exception) as caught:  # which type it is depends on the version of JAX
        failing(jnp.array(1.0)).block_until_ready()
    assert reason(caught.value).endswith("Error: The solver found no root.")
