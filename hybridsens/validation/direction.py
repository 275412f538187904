"""Which way a motion is differentiated: the way that its gradient method does not serve is refused in plain words.

JAX would refuse it too, somewhere inside, in words about loops and custom rules. So the arrays that go into a motion,
or that come out of it, pass a gate: an identity whose tangent may be used in one direction only.
"""

from typing import Any

import equinox as eqx
import jax
import jax.core
from jax.extend.core import Primitive
from jax.interpreters import ad, batching, mlir

IMPLICIT = (
    " A root of what a motion returns (optimistix.root_find: a periodic orbit, shooting) is differentiated implicitly, "
    "in forward mode that is then transposed: adjoint=hybridsens.AnyMode() serves that, and each of the two modes."
)
REVERSE_ONLY = (
    "This gradient method serves reverse mode (jax.grad, jax.vjp, jax.jacrev), and second derivatives by "
    "jax.jacfwd(jax.grad(...)) or jax.hessian, but it must not be used by forward mode (jax.jvp, jax.linearize, "
    "jax.jacfwd) alone. Pass adjoint=hybridsens.ForwardSensitivities() for forward mode."
    + IMPLICIT
)
FORWARD_ONLY = (
    "ForwardSensitivities() serves forward mode (jax.jvp, jax.linearize, jax.jacfwd, also nested), but it must not be "
    "used by reverse mode (jax.grad, jax.vjp, jax.jacrev, jax.hessian). Pass adjoint=hybridsens.Replay() "
    "for gradients, and for second derivatives with it jax.jacfwd(jax.grad(...))."
    + IMPLICIT
)
SECOND_DERIVATIVES = (
    "Second derivatives of a motion are served by forward mode over another mode: use jax.jacfwd(jax.grad(...)) or "
    "jax.hessian, or jax.jacfwd(jax.jacfwd(...)) with adjoint=hybridsens.ForwardSensitivities() or AnyMode(). Reverse "
    "mode over another mode (jax.grad of jax.grad, of jax.jacrev or of jax.jacfwd) must not be used."
)
SETTINGS = (
    "`rtol`, `atol`, `max_step` and `capture_speed` must not be differentiated by: they are settings of the "
    "computation, which the motion depends on by its error only. Hold them constant by jax.lax.stop_gradient."
)


def reverse_only(tree: Any) -> Any:
    """The tree, refused in forward mode; put on what goes into a motion."""
    return _gated(_reverse_gate, tree, REVERSE_ONLY)


def forward_only(tree: Any, reason: str = FORWARD_ONLY) -> Any:
    """The tree, refused in reverse mode; put on what comes out of a motion, where the way back begins."""
    return _gated(_forward_gate, tree, reason)


@eqx.filter_custom_jvp
def not_differentiable(settings: Any) -> Any:
    """The settings, refused where they carry a derivative."""
    return settings


@not_differentiable.def_jvp
def _settings_jvp(primals, tangents):
    if jax.tree.leaves(tangents):
        raise TypeError(SETTINGS)
    return primals[0], jax.tree.map(lambda _: None, primals[0])


def _gated(gate: Primitive, tree: Any, reason: str) -> Any:
    # Only what is traced carries a derivative, and outside of a trace every operation costs a call.
    traced = lambda x: isinstance(x, jax.core.Tracer) and eqx.is_inexact_array(x)
    return jax.tree.map(lambda x: gate.bind(x, reason=reason) if traced(x) else x, tree)


def _refuse(*_, reason: str):
    raise TypeError(reason)


def _identity(name: str) -> Primitive:
    """A linear identity."""
    made = Primitive(name)
    made.def_impl(lambda x, *, reason: x)
    made.def_abstract_eval(lambda x, *, reason: x)
    mlir.register_lowering(made, lambda _, x, *, reason: [x])
    batching.primitive_batchers[made] = lambda given, axes, *, reason: (made.bind(*given, reason=reason), axes[0])
    ad.deflinear2(made, lambda cotangent, x, *, reason: [cotangent])
    return made


def _gate(name: str, of_tangent: Primitive) -> Primitive:
    """An identity that passes its tangent through another one. Its value passes by itself, without a gate: so forward
    mode over reverse mode meets none."""
    made = _identity(name)
    rule = lambda primals, tangents, *, reason: (primals[0], of_tangent.bind(tangents[0], reason=reason))
    ad.primitive_jvps[made] = rule
    return made


# A tangent that may only be transposed: to run it, or a batch of it, is forward mode.
_backward = _identity("reverse_mode_only")
_backward.def_impl(_refuse)
mlir.register_lowering(_backward, _refuse)
batching.primitive_batchers[_backward] = _refuse
_reverse_gate = _gate("reverse_mode_gate", _backward)

# A tangent that may only be run.
_forward = _identity("forward_mode_only")
ad.deflinear2(_forward, _refuse)
_forward_gate = _gate("forward_mode_gate", _forward)
ad.primitive_transposes[_forward_gate] = _refuse
