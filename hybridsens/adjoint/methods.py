"""How a motion is differentiated: the choices for `adjoint=`."""

import equinox as eqx


class AbstractGradientMethod(eqx.Module):
    """One way to differentiate a motion."""


class Replay(AbstractGradientMethod):
    """Reverse mode, exact for the computed motion: recorded steps are replayed backward, jumps between (default).

    Serves `jax.grad`, `jax.vjp`, and second derivatives as forward over reverse (`jax.jacfwd(jax.grad(...))`).
    """


class ForwardSensitivities(AbstractGradientMethod):
    """Forward mode: variations carried along the recorded steps, by saltation matrices (T6) through the events.

    Serves `jax.jvp`, `jax.jacfwd` and their nesting. Costs one tangent pass per direction, and no memory beyond the record.
    """
