"""How a motion is differentiated: the choices for `adjoint=`."""

import abc
from typing import Any, ClassVar

import diffrax
import equinox as eqx

from .step import RecordedStep, StepBack
from .step_adjoint import costate_equation, diffrax_adjoint, exact_adjoint


class AbstractGradientMethod(eqx.Module):
    """One way to differentiate a motion.

    A method of your own says in `carry_back` what a costate psi = dJ/dx becomes over one recorded step. All else is
    done for it: jump conditions at events, samples, the ends of the horizon.

    `rtol` is the error that one step may have in the derivative, relative to the derivative itself. Where the motion is
    trivial (at rest, in free flight, at zero control) its steps are too long for that and are cut. Default: a hundred
    times the `rtol` of the motion, or 1e-5 where that is less, but at least that `rtol`. `math.inf` switches the
    control off. Where the steps needed are more than four times `max_steps`, SimulationError is raised as for a motion
    that failed, and with `throw` other than True the derivative is nan.
    """

    rtol: float | None = eqx.field(default=None, static=True, kw_only=True)

    forward_mode: ClassVar[bool] = False
    """Whether it serves `jax.jvp` and `jax.jacfwd`."""
    reverse_mode: ClassVar[bool] = True
    """Whether it serves `jax.grad` and `jax.vjp`. If not, nothing is ever carried back."""

    @abc.abstractmethod
    def carry_back(self, step: RecordedStep, psi: Any) -> StepBack:
        """psi at the start of a step from that at its end, and what the step adds to dJ/dtheta.

        psi0 = Phi_x^T psi1 and Phi_theta^T psi1 for a step x1 = Phi(theta, t0, x0), or what comes near it. A method
        that returns estimates of its error too has its steps cut until they are small; one that returns none is taken
        as it is."""

    @property
    def step_rtol(self) -> float | None:
        """What a recorded step may be off by in the derivative."""
        return self.rtol

    @property
    def segment_room(self) -> int | None:
        """Room for the steps of one segment, if they are not recorded but run again on the way back. None: they are
        recorded."""
        return None

    def at_tolerance(self, tolerance: Any) -> "AbstractGradientMethod":
        """The same for motions of that tolerance, where it has one of its own that was left at its default."""
        del tolerance
        return self


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
        if not isinstance(self.segment_steps, int) or isinstance(self.segment_steps, bool) or self.segment_steps < 1:
            raise ValueError(f"`segment_steps` must be an integer >= 1, but is {self.segment_steps!r}.")

    def carry_back(self, step: RecordedStep, psi: Any) -> StepBack:
        return exact_adjoint(step, psi)

    @property
    def segment_room(self) -> int | None:
        return self.segment_steps if self.recompute else None


class AnyMode(AbstractGradientMethod):
    """Forward mode as by `ForwardSensitivities()`, reverse mode as by `Replay()`, and one made of the other.

    Serves what differentiates forward and then transposes: the derivative of a root of what a motion returns
    (`optimistix.root_find`: a periodic orbit, shooting), Gauss-Newton steps by products with J and J^T,
    `jax.linear_transpose` of `jax.linearize`. Costs what the two cost; refuses only reverse mode over another mode.
    """

    forward_mode: ClassVar[bool] = True

    def carry_back(self, step: RecordedStep, psi: Any) -> StepBack:
        return exact_adjoint(step, psi)


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

    def carry_back(self, step: RecordedStep, psi: Any) -> StepBack:
        return costate_equation(step, psi, rtol=self.rtol, atol=self.atol, state=self.state)

    @property
    def step_rtol(self) -> None:
        """The equation is solved to `rtol`, however long the recorded steps are."""

    def at_tolerance(self, tolerance: Any) -> "ContinuousCostate":
        """With its default tolerances it gets those of the motion."""
        default = ContinuousCostate()
        if (self.rtol, self.atol) != (default.rtol, default.atol):
            return self
        return eqx.tree_at(lambda method: (method.rtol, method.atol), self, (tolerance, tolerance))


class DiffraxAdjoint(AbstractGradientMethod):
    """Reverse mode with an adjoint of Diffrax inside the segments, jumps between: for comparison.

    `RecursiveCheckpointAdjoint()` and `DirectAdjoint()` give the replay's gradient at a higher cost.
    """

    adjoint: diffrax.AbstractAdjoint = eqx.field(default_factory=diffrax.RecursiveCheckpointAdjoint)

    def __check_init__(self):
        if isinstance(self.adjoint, diffrax.BacksolveAdjoint | diffrax.ForwardMode | diffrax.ImplicitAdjoint):
            raise ValueError(
                "`adjoint` must be RecursiveCheckpointAdjoint() or DirectAdjoint(), Diffrax's discrete adjoints, but "
                f"is {type(self.adjoint).__name__}. For backward integration use "
                'ContinuousCostate(state="backward"), for forward mode ForwardSensitivities().'
            )

    def carry_back(self, step: RecordedStep, psi: Any) -> StepBack:
        return diffrax_adjoint(step, psi, self.adjoint)


class ForwardSensitivities(AbstractGradientMethod):
    """Forward mode: tangents carried along the recorded steps, by saltation matrices (T6) through the events.

    Serves `jax.jvp`, `jax.jacfwd` and their nesting. Costs one tangent pass per direction, and no memory beyond the
    record. The directions of one Jacobian share their steps.
    """

    forward_mode: ClassVar[bool] = True
    reverse_mode: ClassVar[bool] = False

    def carry_back(self, step: RecordedStep, psi: Any) -> StepBack:
        raise TypeError("ForwardSensitivities() carries tangents forward: it has no way back.")
