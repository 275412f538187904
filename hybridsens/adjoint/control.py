"""Error control of a derivative: what the error control of the motion cannot see.

Where a motion is trivial (at rest, in free flight, at zero control) its own error is zero and its steps are long, far
beyond what its variational equation w' = f_x w + f_theta and its costate psi' = -f_x^T psi (T7) need. So the passes
that carry derivatives through a recorded step look at the error estimate E of the step as well, which is a function of
the state and of the parameters like the step Phi itself:

    forward    dE = E_x dx + E_theta dtheta     against  dx before and after the step
    reverse    E_x^T psi and E_theta^T psi      against  psi, and what the step adds to dJ/dtheta

and cut a step that does not resolve them. The motion is resolved already, so any shorter steps follow it.
"""

from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
from jax import lax
from jaxtyping import Array, Float

FLOOR = 1e-2
"""Each entry is resolved relative to itself, but to no less than this part of the largest entry."""
REFINED = 0.05
"""A step that must be cut is made so short that its predicted error is this part of the allowed one. The embedded
estimate is of lower order than the step, so it overestimates the error of short steps."""
NOISE = 1e3
"""A derivative that is smaller than NOISE eps times its largest size so far is rounding."""
ROUNDED = 8
"""An estimated error below ROUNDED eps times that size is rounding, and is ignored."""
FORESEEN = 0.01
"""The second sweep measures errors by no less than this part of what the first one has gathered."""
PATIENCE = 1 / 16
"""The part of all tries after which errors that may be rounding are taken for it."""
PART = 0.1
"""What a step adds to dJ/dtheta may be wrong by this part of `rtol`: what the steps add may cancel in the sum."""


class DerivativeControl(eqx.Module):
    """How well each step must resolve a derivative."""

    rtol: Any
    """Largest error of one step, relative; inf for no control."""
    least_state: Any
    """Size of a state entry below which the tolerances of the motion do not look, atol / rtol."""
    order: float = eqx.field(static=True)
    """At which power of the step the estimated error falls."""
    most_tries: int = eqx.field(static=True)
    """How many steps may be tried in all."""

    def of_state(self, x, before, after, error, peak, tries) -> tuple[Array, Array]:
        """Error of a tangent over what is allowed, and its size; `before` and `after` are its values at the ends of
        the step, `peak` is the largest size that it had.

        The error of an entry is compared with the entry itself, and with a part of the largest one: entries are made
        comparable by the sizes of the state. A tangent that a contact has wiped out but for rounding has no error. One
        that begins with 0, as by the stiffness of a spring that is not stretched yet, may be made of nothing but
        rounding, which no shorter step would mend: once a part of all tries is spent on `tries`, an error below one
        rounding of what a tangent is made from is none. Not before: that size overestimates weak effects."""
        unit = jnp.abs(x) + self.least_state
        ratio, size = self._of_entries(unit, before, after, error, peak)
        rounded = is_noise(jnp.max(jnp.abs(error) / unit, initial=0), peak, roundings=1)
        return jnp.where(rounded & (tries > PATIENCE * self.most_tries), 0, ratio), size

    def of_costate(self, x, before, after, error, peak) -> tuple[Array, Array]:
        """The same of a costate, whose units are the inverse ones."""
        return self._of_entries(1 / (jnp.abs(x) + self.least_state), before, after, error, peak)

    def _of_entries(self, unit, before, after, error, peak):
        own = jnp.maximum(jnp.abs(before), jnp.abs(after))
        size = jnp.max(own / unit, initial=0)
        ratio = _largest_ratio(jnp.abs(error), own + FLOOR * size * unit) / self.rtol
        return jnp.where(is_noise(size, peak), 0, ratio), size

    def of_direction(self, parameters, d_parameters, x0, dx0) -> Float[Array, ""]:
        """Size of a direction: relative to each parameter, or to 1 if that is more, and to the state. It is the first
        `peak`: a tangent that is smaller by rounding is none."""
        sizes = [jnp.max(jnp.abs(dx0) / (jnp.abs(x0) + self.least_state), initial=0)]
        for parameter, direction in zip(*map(jax.tree.leaves, (parameters, d_parameters)), strict=True):
            most = jnp.max(jnp.abs(direction), initial=0)
            sizes.append(most / jnp.maximum(jnp.max(jnp.abs(parameter), initial=0), 1))
        return lax.stop_gradient(jnp.max(jnp.stack([jnp.asarray(size, x0.dtype) for size in sizes])))

    def of_gradient(self, parameters, gathered, error, peak) -> Float[Array, ""]:
        """Error of what a step adds to dJ/dtheta over what is allowed.

        Measured by all that is `gathered`, without cancellation: so neither the unit of a parameter matters nor its
        value, which may be 0. Entries of one array are resolved down to a part of its largest. A parameter that changes
        J by no more than rounding, by its whole value or by 1, has no error, and an error of a few roundings
        is none either."""
        worst = jnp.zeros_like(peak)
        for parameter, so_far, wrong in zip(*map(jax.tree.leaves, (parameters, gathered, error)), strict=True):
            worst = jnp.maximum(worst, self._of_leaf(parameter, so_far, wrong, peak).astype(worst.dtype))
        return worst / (PART * self.rtol)

    def _of_leaf(self, parameter, gathered, error, peak):
        if parameter.size == 0:
            return jnp.zeros_like(peak)
        gathered = jnp.real(gathered)  # sizes, in the type of the parameter, which may be complex
        most = jnp.max(gathered)
        ratio = _largest_ratio(jnp.abs(error), gathered + FLOOR * most)
        reach = jnp.maximum(jnp.max(jnp.abs(parameter)), 1)
        # Near rest an effect may be as small as the rounding of what it is made from: no shorter step would mend that.
        rounded = is_noise(jnp.max(jnp.abs(error)) * reach, peak, ROUNDED)
        return jnp.where(is_noise(most * reach, peak) | rounded, 0, ratio)

    def judge(self, ratio, h, width):
        """Whether a step is short enough, and the longest step that would be."""
        accepted = ~(ratio > 1)
        longest = lambda: h * jnp.clip(jnp.maximum(ratio, 1e-9) ** (-1 / self.order), 0.1, 5.0)
        stays_unlimited = accepted & jnp.isinf(width)  # the usual case pays for no power
        return accepted, lax.cond(stays_unlimited, lambda: width, longest)

    def cut(self, width):
        """Length of the parts into which a step longer than `width` is cut."""
        return width * REFINED ** (1 / self.order)


def of_all_directions(ratio):
    """The largest ratio of all directions of a Jacobian (`jax.jacfwd`), which share their steps."""
    return _largest_of_directions(lax.stop_gradient(ratio))


@jax.custom_batching.custom_vmap
def _largest_of_directions(ratio):
    """The ratio itself; under `jax.vmap` the largest along the axis."""
    return ratio


@_largest_of_directions.def_vmap
def _largest_of_directions_vmap(axis_size, in_batched, ratio):
    del axis_size
    return jnp.max(ratio, initial=0) if in_batched[0] else ratio, False  # there may be none


def is_noise(size, peak, roundings=NOISE):
    """Whether what a derivative was has been wiped out but for rounding."""
    return size <= roundings * jnp.finfo(peak.dtype).eps * peak


def _largest_ratio(error, scale):
    return jnp.max(jnp.where(error > 0, error / jnp.where(scale > 0, scale, 1), 0), initial=0)
