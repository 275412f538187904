"""How a motion is differentiated: the choices for `adjoint=`."""

import diffrax
import equinox as eqx


class AbstractGradientMethod(eqx.Module):
    """One way to differentiate a motion.

    `rtol` is the error that one step may have in the derivative, relative to the derivative itself. Where the motion is
    trivial (at rest, in free flight, at zero control) its steps are too long for that and are cut. Default: a hundred
    times the `rtol` of the motion, or 1e-5 where that is less, but at least that `rtol`. `math.inf` switches the
    control off. Where the steps needed are more than four times `max_steps`, the derivative is nan.
    """

    rtol: float | None = eqx.field(default=None, static=True, kw_only=True)

    @property
    def step_rtol(self) -> float | None:
        """What a recorded step may be off by in the derivative."""
        return self.rtol


class Replay(AbstractGradientMethod):
    """Reverse mode, exact for the computed motion: recorded steps are replayed backward, jumps between (default).

    Serves `jax.grad`, `jax.vjp`, and second derivatives as forward over reverse (`jax.jacfwd(jax.grad(...))`).

    With `recompute=True` only the events are recorded and every segment is run again on the way back: memory for the
    events and the steps of one segment, for about one more forward solve. A segment then has room for `segment_steps`
    steps, samples `ts` are refused, and second derivatives too.
    """

    recompute: bool = eqx.field(default=False, static=True)
    segment_steps: int = eqx.field(default=1024, static=True)

    def __check_init__(self):
        if not isinstance(self.segment_steps, int) or self.segment_steps < 1:
            raise ValueError(f"`segment_steps` must be an integer >= 1, but is {self.segment_steps!r}.")


class ContinuousCostate(AbstractGradientMethod):
    """Reverse mode by the paper's adjoint equation psi' = -f_x^T psi (T7), integrated backward with its own tolerances.

    Differs from the derivative of the computed motion by the tolerances of both passes. `state` says where the motion
    comes from on the way back: "recorded" (steps of the solver from the recorded ones) or "backward" (integrated
    backward from the end of every recorded step; unstable over a step where the motion is strongly dissipative, which
    is warned of).
    """

    rtol: float = 1e-8
    atol: float = 1e-8
    state: str = eqx.field(default="recorded", static=True)

    def __check_init__(self):
        if self.state not in ("recorded", "backward"):
            raise ValueError(f'`state` must be "recorded" or "backward", but is {self.state!r}.')

    @property
    def step_rtol(self) -> None:
        """The equation is solved to `rtol`, however long the recorded steps are."""


class DiffraxAdjoint(AbstractGradientMethod):
    """Reverse mode with an adjoint of Diffrax inside the segments, jumps between: for comparison.

    `RecursiveCheckpointAdjoint()` and `DirectAdjoint()` give the replay's gradient at a higher cost.
    """

    adjoint: diffrax.AbstractAdjoint = eqx.field(default_factory=diffrax.RecursiveCheckpointAdjoint)

    def __check_init__(self):
        if isinstance(self.adjoint, diffrax.BacksolveAdjoint | diffrax.ForwardMode):
            raise ValueError(
                f"`adjoint` must be one of Diffrax's discrete adjoints, but is {type(self.adjoint).__name__}. "
                'For backward integration use ContinuousCostate(state="backward"), '
                "for forward mode ForwardSensitivities()."
            )


class ForwardSensitivities(AbstractGradientMethod):
    """Forward mode: variations carried along the recorded steps, by saltation matrices (T6) through the events.

    Serves `jax.jvp`, `jax.jacfwd` and their nesting. Costs one tangent pass per direction, and no memory beyond the
    record. The directions of one Jacobian share their steps.
    """
