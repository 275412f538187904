"""What held contacts meet inside a step.

Where all that moves is held or moves freely along its contacts, the flow is trivial and no error limits the steps. A
load that depends on time or place, or supports that move aside, may then let a contact go, and press it again, between
the ends of a step. And a gap may have a hill between the stages of a step, which the motion would pass through. Both
are looked for by bounds, and the step is halved where they come.
"""

import jax
import jax.numpy as jnp
import numpy as np
from jax import lax
from jaxtyping import Array, Bool, Float

from ..flat_system import Searched, StepEnds
from ..interval.kind import Kind, kinds
from ..numerics.tolerances import closeness, rounding
from ..search.gap_search import search_gaps
from ..search.path import Path
from ..search.stretch import Nearness
from .contact import Among, among_held, contact_geometry, contact_jacobian, walls_move
from .mode import ContactMode
from .scene import AbstractScene

SLACK = 1e-2
"""By what part of its own length, seen along the gap's gradient, the cubic of a resolved step may leave a contact that
is held along a curve."""

LEAST_WAY = 1 / 16
"""What part of a step a search for a load's dip must get through, to count as one that found something in its way."""


def load_varies(scene: AbstractScene, t, q, v) -> bool:
    """Whether a force bends along the way of a held body, as far as its trace tells: by time, and by place where a body
    that is held can move."""
    still, moves = (np.full(q.shape, kind) for kind in (Kind.CONSTANT, Kind.AFFINE))
    trace = jax.make_jaxpr(scene._load)(t, q, v)
    place = moves if walls_move(scene, t, q) or q.shape[0] > 1 else still
    return bool((kinds(trace, [np.array(Kind.AFFINE), place, still]) >= Kind.CURVED).any())


def supports_move(scene: AbstractScene, t, q) -> bool:
    """Whether a gap's gradient depends on time, so that a body that does not move may hang on its contacts in turn."""
    if not walls_move(scene, t, q):
        return False
    by_time = [np.array(Kind.AFFINE), np.full(q.shape, Kind.CONSTANT)]
    trace = jax.make_jaxpr(lambda t, q: contact_jacobian(scene, t, q))(t, q)
    return bool(kinds(trace, by_time).any())


def search_load(scene: AbstractScene, path: Path, step: StepEnds, mode: ContactMode, tolerance, wanted) -> Searched:
    """Whether a load lets a held contact go inside a step: then the step is halved, until its ends tell.

    The multipliers are followed as lambda(s) = -W^-1 G^T M^-1 F along the path, with W^-1 G^T M^-1 as it is at the
    start, and what that leaves at both ends taken off in proportion to s. Where supports move, F is what the load and
    multipliers in proportion to s leave unbalanced, F + G lambda."""
    h, t0 = path.h, path.t0
    moved = supports_move(scene, t0, path.coefficients[0])

    def look():
        lift = _multipliers_of_a_load(scene, t0, path.coefficients[0], mode.active)
        v0, v1 = (path.at(s)[2] / h for s in (0.0, 1.0))
        held0, held1 = (jnp.where(mode.active, guard, 0) for guard in (step.guard0, step.guard1))

        def force(t, q):
            s = (t - t0) / h
            load = scene._load(t, q, v0 + s * (v1 - v0))
            if not moved:
                return load
            return load + jax.vjp(lambda q: scene.gap(t, q), q)[1](held0 + s * (held1 - held0))[0]

        def at_end(s):
            t, q, slope = path.at(s)
            return jax.jvp(force, (t, q), (jnp.ones_like(h), slope / h))

        (load0, change0), (load1, change1) = at_end(0.0), at_end(1.0)
        largest = jnp.maximum(jnp.abs(load0), jnp.abs(load1))
        rounded = 8 * rounding(h.dtype) * (jnp.abs(lift) @ largest)  # and what bounds add to it
        # One that is held without a force has none: no bound would ever prove that to rounding.
        rounded += closeness(h.dtype) ** -0.5 * mode.margin
        off0, off1 = step.guard0 - lift @ load0, step.guard1 - lift @ load1

        def multiplier(t, q):
            s = (t - t0) / h
            return lift @ force(t, q) + (1 - s) * off0 + s * off1

        rate0, rate1 = (lift @ change + (off1 - off0) / h for change in (change0, change1))
        ends = step._replace(rate0=rate0, rate1=rate1)
        nearness = Nearness.roughly(tolerance + rounded, mode.active)
        found = search_gaps(multiplier, path, ends, nearness, jnp.array(True))
        # A search that is given up at once proves nothing: bounds of a corner that is rounded off are wide on any step.
        reached = jnp.where(found.reached < LEAST_WAY, nothing.reached, found.reached)
        return nothing._replace(reached=jnp.where(jnp.isfinite(found.crossing), 0.5, reached))

    nothing = Searched.nothing(t0)
    return lax.cond(wanted & jnp.any(mode.active), look, lambda: nothing)


def _multipliers_of_a_load(scene: AbstractScene, t, q, active: Bool[Array, "contact"]) -> Float[Array, "contact dof"]:
    """-W_AA^-1 G_A^T M^-1: the multipliers of the active contacts by each force."""

    def among(scene, active):
        geometry, members = contact_geometry(scene, t, q), active.astype(q.dtype)
        of_one = lambda kick: geometry.delassus.solve(-kick, members)
        return jax.vmap(of_one, in_axes=1, out_axes=1)(geometry.mobility.T), ()

    nothing = jnp.zeros((active.shape[0], q.shape[0]), q.dtype)
    return among_held(scene, active, q.shape[0], Among(among, active, nothing))[0]


def search_way(scene: AbstractScene, path: Path, step: StepEnds, mode: ContactMode, depth, wanted) -> Searched:
    """Whether the way through a step leaves a held contact by more than `depth`: then its stages have not seen what the
    gap does between them, and the step is halved."""
    held = jnp.concatenate([mode.active, mode.active])

    def off(t, q):
        beside = scene.gap(t, q) - mode.held_gap
        return jnp.concatenate([beside, -beside])

    def look():
        slack = depth + SLACK * jnp.abs(contact_jacobian(scene, path.t0, path.coefficients[0])) @ path.ways()
        nothing = jnp.zeros(held.shape, path.t0.dtype)  # at its ends the motion is on its contacts
        ends = step._replace(guard0=nothing, rate0=nothing, guard1=nothing, rate1=nothing)
        found = search_gaps(off, path, ends, Nearness.roughly(jnp.concatenate([slack, slack]), held), jnp.array(True))
        # A search that is given up proves nothing: bounds of a corner that is rounded off are wide.
        return stays._replace(reached=jnp.where(jnp.isfinite(found.crossing), 0.5, stays.reached))

    stays = Searched.nothing(path.t0)
    return lax.cond(wanted & jnp.any(mode.active), look, lambda: stays)
