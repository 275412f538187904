"""What held contacts meet inside a step.

Where everything that moves is held, the flow is trivial and no error limits the steps. A load that depends on time may
then let a contact go, and press it again, between the ends of a step: its multiplier is looked at inside of it too. And
a gap may have a hill between the stages of a step, which the motion would pass through: its way is looked at as well.
"""

from itertools import pairwise

import jax
import jax.numpy as jnp
import numpy as np
from jax import lax

from ..flat_system import Searched, StepEnds
from ..interval.kind import Kind, kinds
from ..numerics.cubic import hides_a_dip
from ..search.path import Path
from ..search.stretches import search_gaps
from .contact import contact_jacobian
from .flow import multipliers_and_rates
from .mode import ContactMode
from .scene import AbstractScene

PLACES = (0.29, 0.62)
"""Where inside a step multipliers are looked at: at uneven fractions, so that no period fits them all."""


SLACK = 1e-2
"""By what part of its own length, seen along the gap's gradient, the cubic of a resolved step may leave a contact that
is held along a curve."""


def load_varies(scene: AbstractScene, t, q, v) -> bool:
    """Whether a force depends on time, by more than a straight line, as far as its trace tells."""
    trace = jax.make_jaxpr(scene.force)(t, q, v)
    of = (Kind.AFFINE, Kind.CONSTANT, Kind.CONSTANT)
    arguments = [np.full(x.shape, kind) for x, kind in zip(trace.in_avals, of, strict=True)]
    return bool((kinds(trace, arguments) >= Kind.CURVED).any())


def search_held(scene: AbstractScene, path: Path, step: StepEnds, mode: ContactMode, tolerance, wanted) -> Searched:
    """Where the multiplier of a held contact is found below zero inside a step. A step is halved where the cubics
    through the multipliers and their rates, at its ends and between, could be missing a dip."""
    watched = lambda multiplier, rate: (jnp.where(mode.active, multiplier, 1), jnp.where(mode.active, rate, 0))

    def sample(s):
        t, q, slope = path.at(s)
        return watched(*multipliers_and_rates(scene, t, q, slope / path.h, mode.active))

    def look():
        inside = lax.map(sample, jnp.asarray(PLACES, path.t0.dtype))  # one copy to compile
        at = [watched(step.guard0, step.rate0), *zip(*inside, strict=True), watched(step.guard1, step.rate1)]
        crossing, unsure = jnp.full_like(path.t0, jnp.inf), jnp.array(False)
        for s, (multiplier, _) in reversed(list(zip(PLACES, at[1:-1], strict=True))):
            crossing = jnp.where(jnp.any(multiplier < -tolerance), s, crossing)
        for (s0, (g0, d0)), (s1, (g1, d1)) in pairwise(zip((0.0, *PLACES, 1.0), at, strict=True)):
            width = (s1 - s0) * path.h
            unsure = unsure | hides_a_dip(g0, width * d0, g1, width * d1, tolerance)
        return Searched(crossing, jnp.where(unsure, 0.5, jnp.ones_like(path.t0)))

    nothing = Searched(jnp.full_like(path.t0, jnp.inf), jnp.ones_like(path.t0))
    return lax.cond(wanted & jnp.any(mode.active), look, lambda: nothing)


def search_way(scene: AbstractScene, path: Path, step: StepEnds, mode: ContactMode, depth, wanted) -> Searched:
    """Whether the way through a step leaves a held contact by more than `depth`: then its stages have not seen what the
    gap does between them, and the step is halved."""
    held = jnp.concatenate([mode.active, mode.active])

    def off(t, q):
        beside = scene.gap(t, q) - mode.held_gap
        return jnp.concatenate([beside, -beside])

    def look():
        way = jnp.abs(path.coefficients[1]) + jnp.abs(sum(path.coefficients[1:]))
        slack = depth + SLACK * jnp.abs(contact_jacobian(scene, path.t0, path.coefficients[0])) @ way
        nothing = jnp.zeros(held.shape, path.t0.dtype)  # at its ends the motion is on its contacts
        ends = step._replace(guard0=nothing, rate0=nothing, guard1=nothing, rate1=nothing)
        found = search_gaps(off, path, ends, jnp.concatenate([slack, slack]), held, jnp.array(True))
        # A search that is given up proves nothing: bounds of a corner that is rounded off are wide.
        return stays._replace(reached=jnp.where(jnp.isfinite(found.crossing), 0.5, stays.reached))

    stays = Searched(jnp.full_like(path.t0, jnp.inf), jnp.ones_like(path.t0))
    return lax.cond(wanted & jnp.any(mode.active), look, lambda: stays)
