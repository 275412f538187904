"""Bodies in a plane: places and velocities of their points, and gaps between discs, lines, segments and polygons.

Every gap is that of discs with centres `points` (..., 2) and one `radius` [m]; radius 0 makes them points. It is
positive apart, 0 at touch, and has a gradient of length 1 there, so that closing speeds are speeds. Hand what these
functions return to `gap`, joined by `jnp.concatenate` or `jnp.stack`.

A gap must be smooth where bodies may touch. So a set of walls around a body gives one gap for each wall, not their
minimum: in a corner two of them close, and the law of simultaneous impacts decides. Where a body goes round the corner
of an obstacle there is one gap, and the disc's own radius is what rounds the corner off.
"""

import functools
from collections.abc import Callable

import jax
import jax.core
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float


def velocity(point: Callable[[Array], Array], q: Float[Array, "dof"], v: Float[Array, "dof"]) -> Array:
    """Velocity of a point that moves with q: (d point / d q) v [m/s].

    `point(q)` is its place, of any shape; angles work too. `0.5 * mass * (s @ s)` with s = velocity(...) is the kinetic
    energy of a mass there."""
    return jax.jvp(point, (q,), (v,))[1]


def place(
    points: Float[Array, "*points 2"], position: Float[Array, "2"], angle: Float[Array, ""] | float
) -> Float[Array, "*points 2"]:
    """Where points of a body are, given in the body's own axes, when its origin is at `position` and it is turned by
    `angle` [rad], counter-clockwise."""
    c, s = jnp.cos(angle), jnp.sin(angle)
    x, y = jnp.asarray(points)[..., 0], jnp.asarray(points)[..., 1]
    return jnp.asarray(position) + jnp.stack([c * x - s * y, s * x + c * y], axis=-1)


def to_half_plane(points, through, normal, radius=0.0) -> Float[Array, "*points"]:
    """Gap to the half plane below a line: n . (x - through) - radius, n = normal / |normal|, which points to where the
    bodies are. The corners of a polygon, (corner, 2), give a gap each."""
    normal = jnp.asarray(normal)
    unit = normal / jnp.sqrt(normal @ normal)
    return (jnp.asarray(points) - jnp.asarray(through)) @ unit - radius


def to_disc(points, centre, disc_radius, radius=0.0) -> Float[Array, "*points"]:
    """Gap to a disc, from outside: |x - centre| - disc_radius - radius. Two moving discs are one call: `centre` may
    move too."""
    return _length(jnp.asarray(points) - jnp.asarray(centre)) - disc_radius - radius


def inside_disc(points, centre, disc_radius, radius=0.0) -> Float[Array, "*points"]:
    """Gap to the rim of a disc, from inside: ((R - r)^2 - |x - centre|^2) / (2 (R - r)).

    That is R - r - |x - centre| to first order at the rim, and smooth at the centre too, where the distance is not; at
    the centre it is half the distance."""
    room = disc_radius - radius
    offset = jnp.asarray(points) - jnp.asarray(centre)
    return (room * room - jnp.sum(offset * offset, axis=-1)) / (2 * room)


def to_segment(points, start, end, radius) -> Float[Array, "*points"]:
    """Gap to the straight line between two points: the distance to its nearest point, less the radius.

    The radius must be positive: it rounds the ends off. The curvature of the gap still jumps where the nearest point
    comes to an end. A fast body that slides over that place is let go right there, and the status is `guard_jumps`:
    its derivatives need that place as a switch, (x - end) . (start - end), of an `AbstractSwitchedScene`."""
    _must_be_round(radius, "to_segment")
    return _distance_to_segment(*map(jnp.asarray, (points, start, end))) - radius


def to_polygon(points, corners: Float[Array, "corner 2"], radius) -> Float[Array, "*points"]:
    """Gap to a convex polygon, from outside: the distance to the nearest of its edges, less the radius.

    The radius must be positive, as for `to_segment`, and centres must stay outside. A polygon that is not convex has
    corners in which two gaps close at once: build it of convex ones, with a gap each."""
    _must_be_round(radius, "to_polygon")
    return _distance_to_polygon(jnp.asarray(points), jnp.asarray(corners)) - radius


def inside_polygon(points, corners: Float[Array, "corner 2"], radius=0.0) -> Float[Array, "*points corner"]:
    """Gaps to the walls of a convex room, one for each edge, from corner i to corner i + 1. Corners run
    counter-clockwise."""
    corners = jnp.asarray(corners)
    along = jnp.roll(corners, -1, axis=0) - corners
    inward = jnp.stack([-along[:, 1], along[:, 0]], axis=-1) / _length(along)[:, None]
    offset = jnp.asarray(points)[..., None, :] - corners
    return jnp.sum(offset * inward, axis=-1) - radius


def circle(centre, radius, count: int = 48) -> np.ndarray:
    """Outline of a disc, (count + 1, 2), with a last point that is the first: for `draw` of an animation."""
    angle = np.linspace(0, 2 * np.pi, count + 1)
    return np.asarray(centre) + np.asarray(radius) * np.stack([np.cos(angle), np.sin(angle)], axis=-1)


def line(*points) -> np.ndarray:
    """Outline that goes through points (2,), one after the other: (point, 2)."""
    return np.array([[float(number) for number in point] for point in points])


def rectangle(low, high) -> np.ndarray:
    """Outline of a rectangle between two opposite corners, (5, 2), with a last point that is the first."""
    (left, bottom), (right, top) = np.asarray(low), np.asarray(high)
    return np.array([[left, bottom], [right, bottom], [right, top], [left, top], [left, bottom]])


def links(angles, lengths) -> np.ndarray:
    """Places of the joints of links that hang from the origin, it among them, (link + 1, 2); angles are those from
    hanging down [rad], counter-clockwise."""
    angles, lengths = np.asarray(angles), np.asarray(lengths)
    steps = lengths[:, None] * np.stack([np.sin(angles), -np.cos(angles)], axis=-1)
    return np.concatenate([np.zeros((1, 2)), np.cumsum(steps, axis=0)])


def _length(vectors):
    return jnp.sqrt(jnp.sum(vectors * vectors, axis=-1))


def _distance_to_segment(points, start, end):
    """By squares of what lies beyond either end: these have a derivative also where the nearest point comes to an end,
    and its own place has none there."""
    length = _length(end - start)
    along, offset = (end - start) / length, points - start
    ahead, aside = offset @ along, offset @ jnp.stack([-along[1], along[0]])
    before, beyond = jnp.maximum(-ahead, 0), jnp.maximum(ahead - length, 0)
    return jnp.sqrt(aside**2 + before**2 + beyond**2)


@jax.jit  # a call that the search for kinks in traces knows by its name: outside, the nearest edge changes smoothly
def _distance_to_polygon(points, corners):
    edges = jax.vmap(lambda start, end: _distance_to_segment(points, start, end))
    distances = edges(corners, jnp.roll(corners, -1, axis=0))
    # One by one, because the search for dips of a gap has bounds for a minimum of two, and none for one over an axis.
    return functools.reduce(jnp.minimum, [distances[i] for i in range(corners.shape[0])])


def _must_be_round(radius, name: str) -> None:
    """Raise ValueError for a radius that can be seen to be 0 or less."""
    if not isinstance(radius, jax.core.Tracer) and not np.all(np.asarray(radius) > 0):
        raise ValueError(
            f"`radius` of `planar.{name}` must be positive, but is {radius}: it is what makes the gap smooth at a "
            "corner. Give the body a small radius, or describe a point against straight walls by `to_half_plane`."
        )
