"""A scene written as energies: its mass matrix and its forces come out of them by automatic differentiation."""

import abc
import inspect
from types import CodeType

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from ..interval.kind import Kind, kinds
from ..validation.asked import Asked
from ..validation.caller import warn_caller
from ..validation.returned import described, must_have_shape
from .scene import AbstractScene


class LagrangianScene(AbstractScene):
    """A mechanical system given by its energies, with ideal unilateral constraints.

        d/dt (dT/dv) - dT/dq + dV/dq + dR/dv = Q(t, q, v) + G lambda,   0 <= lambda _|_ Phi(t, q) >= 0

    Subclass it, give it fields, and write `kinetic_energy`, `gap` and `restitution`; `potential_energy`, `dissipation`
    and `applied_force` where there are any. What `AbstractScene` asks for follows:

        M(q) = d2T/dv2,    F = dT/dq - (d2T/dv dq) v - dV/dq - dR/dv + Q

    so that the Coriolis and centrifugal forces are right by construction. T is quadratic in v; terms linear in v and
    terms without v are allowed.

    Raises: ValueError when the motion is compiled, if an energy is no scalar or T is not quadratic in v.
    """

    def __init_subclass__(cls, **options):
        super().__init_subclass__(**options)
        _warn_of_own_force(cls)
        _warn_of_unread_force(cls)

    @abc.abstractmethod
    def kinetic_energy(self, q: Float[Array, "dof"], v: Float[Array, "dof"]) -> Float[Array, ""]:
        """T(q, v) [J], quadratic in v. The velocity of a point is `hybridsens.planar.velocity(point, q, v)`."""

    def potential_energy(self, q: Float[Array, "dof"]) -> Float[Array, ""]:
        """V(q) [J]; 0 unless a scene says otherwise."""
        return jnp.zeros((), q.dtype)

    def dissipation(self, q: Float[Array, "dof"], v: Float[Array, "dof"]) -> Float[Array, ""]:
        """Rayleigh's function R(q, v) [W]: its force is -dR/dv. A damper of constant c has R = c s'^2 / 2; 0 unless a
        scene says otherwise."""
        del v
        return jnp.zeros((), q.dtype)

    def applied_force(self, t: Float[Array, ""], q: Float[Array, "dof"], v: Float[Array, "dof"]) -> Float[Array, "dof"]:
        """Generalised forces Q(t, q, v) that come from no energy: motors, controls, drives [N, N m]; 0 unless a scene
        says otherwise."""
        del t, v
        return jnp.zeros_like(q)

    def energy(self, q: Float[Array, "dof"], v: Float[Array, "dof"]) -> Float[Array, ""]:
        """T + V at one state [J]."""
        return self._kinetic(q, v) + self._potential(q)

    def mass_matrix(self, q: Float[Array, "dof"]) -> Float[Array, "dof dof"]:
        """M(q) = d2T/dv2."""
        of_state = lambda q, v: jax.jacfwd(jax.grad(self._kinetic, argnums=1), argnums=1)(q, v)
        _refuse_if_it_depends_on_v(of_state, q)
        return of_state(q, jnp.zeros_like(q))

    def force(self, t: Float[Array, ""], q: Float[Array, "dof"], v: Float[Array, "dof"]) -> Float[Array, "dof"]:
        """F = dT/dq - (d2T/dv dq) v - dV/dq - dR/dv + Q."""
        return self._of_inertia(q, v) + self._without_inertia(t, q, v)

    def _load(self, t, q, v):
        """All forces, or those without inertia where inertia alone lets no held contact go unseen. A `force` of the
        class's own cannot be told apart."""
        written = type(self).force is not LagrangianScene.force
        return self.force(t, q, v) if written or self._inertia_may_lift(t, q, v) else self._without_inertia(t, q, v)

    def _inertia_may_lift(self, t, q, v) -> bool:
        """Whether inertia bends along the way of a body while a gap is affine in a coordinate, so that the body may
        hold its contact at a constant velocity: along a track in coordinates of the track. Where no gap is, the
        velocity of a held body turns, the error of that limits the steps, and to bound inertia costs most of the
        compilation."""
        still, moves = (np.full(q.shape, kind) for kind in (Kind.CONSTANT, Kind.AFFINE))
        if (kinds(jax.make_jaxpr(self._of_inertia)(q, v), [moves, still]) < Kind.CURVED).all():
            return False
        gaps = jax.make_jaxpr(self.gap)(t, q)
        alone = np.where(np.eye(q.shape[0], dtype=bool), Kind.AFFINE, Kind.CONSTANT)
        return any((kinds(gaps, [np.array(Kind.CONSTANT), one]) == Kind.AFFINE).any() for one in alone)

    def _of_inertia(self, q, v):
        """dT/dq - (d2T/dv dq) v."""
        momentum = lambda q: jax.grad(self._kinetic, argnums=1)(q, v)
        convected = jax.jvp(momentum, (q,), (v,))[1]  # how dT/dv changes because q does
        return jax.grad(self._kinetic)(q, v) - convected

    def _without_inertia(self, t, q, v):
        """-dV/dq - dR/dv + Q."""
        dissipated = jax.grad(lambda v: _scalar(Asked.of(self, "dissipation(q, v)"), q, v))(v)
        return _applied(self, t, q, v) - jax.grad(self._potential)(q) - dissipated

    def _kinetic(self, q, v):
        return _scalar(Asked.of(self, "kinetic_energy(q, v)"), q, v)

    def _potential(self, q):
        return _scalar(Asked.of(self, "potential_energy(q)"), q)


def _warn_of_own_force(cls: type) -> None:
    """Say where a class writes `force` and not `mass_matrix`, and does not build on the force that follows."""
    written = getattr(vars(cls).get("force"), "__code__", None)
    if written is None or "mass_matrix" in vars(cls) or {"super", "LagrangianScene"} & set(written.co_names):
        return
    warn_caller(
        f"{cls.__name__} defines `force`, which takes the place of all forces that follow from its energies. Is "
        "`applied_force` meant, which is added to them? To write all forces by hand, write `mass_matrix` too."
    )


def _warn_of_unread_force(cls: type) -> None:
    """Say where a class writes a force under a name of its own, `external_force(t, q, v)`, which no method mentions.

    One that writes `applied_force` as well knows that name: what else it has is for its own use."""
    if cls.applied_force is not LagrangianScene.applied_force:
        return
    methods = {name: method for of in reversed(cls.__mro__) for name, method in vars(of).items()}
    codes = {name: method.__code__ for name, method in methods.items() if inspect.isfunction(method)}
    mentioned = set().union(*map(_words, codes.values()))
    for name in sorted((vars(cls).keys() & codes.keys()) - mentioned - {"force"}):
        arguments = codes[name].co_varnames[1 : codes[name].co_argcount]
        if arguments == ("t", "q", "v") and ("force" in name or "torque" in name):
            warn_caller(
                f"{cls.__name__} defines `{name}`, which none of its methods mentions. Is `applied_force` meant, which "
                "is added to the forces that follow from the energies?"
            )


def _words(code: CodeType) -> set[str]:
    """Names that a function mentions, those of the functions inside of it too."""
    inner = [constant for constant in code.co_consts if isinstance(constant, CodeType)]
    return set(code.co_names).union(*map(_words, inner))


def _scalar(asked: Asked, *arguments) -> Float[Array, ""]:
    """An energy. Raises: TypeError or ValueError where it is no real scalar."""
    energy = asked(*arguments)
    energy = jnp.asarray(float(energy)) if type(energy) in (int, float) else energy  # none at all: `return 0`
    shape = described(asked, energy).shape
    if shape != ():
        raise ValueError(
            f"`{asked.name}` must return a scalar, but {asked.it}returns shape {shape}. Sum over its parts, or take "
            "the one entry: `0.5 * mass * v[0] ** 2`, or `0.5 * mass * v @ v`."
        )
    return energy


def _applied(scene: LagrangianScene, t, q, v):
    asked = Asked.of(scene, "applied_force(t, q, v)")
    force = asked(t, q, v)
    must_have_shape(asked, described(asked, force), q.shape)
    return force


def _refuse_if_it_depends_on_v(hessian, q) -> None:
    """Raise ValueError if the trace of d2T/dv2 still has v in it. It costs nothing when the motion runs."""
    trace = jax.make_jaxpr(hessian)(q, q)
    known = [np.full(q.shape, Kind.CONSTANT), np.full(q.shape, Kind.AFFINE)]
    if (kinds(trace, known) != Kind.CONSTANT).any():
        raise ValueError(
            "`kinetic_energy` must be quadratic in v, but its second derivative by v depends on v. Write each velocity "
            "as linear in v, by `hybridsens.planar.velocity(point, q, v)` for example, and square it by `s * s` or "
            "`s @ s`. Where it is quadratic and its trace does not show that, write the method `mass_matrix` yourself."
        )
