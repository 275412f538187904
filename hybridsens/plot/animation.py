"""A moving picture of a planar scene, from the outlines of its bodies."""

import base64
import inspect
import tempfile
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.animation import FuncAnimation, PillowWriter
from matplotlib.axes import Axes

from ..mechanics.scene import AbstractScene
from ..mechanics.trajectory import Trajectory
from .figure import COLOURS, Picture, must_be_sampled

MOST_FRAMES = 600


class Animation:
    """A moving picture: `save` writes a GIF or an HTML page, and a notebook shows it."""

    def __init__(self, moving: FuncAnimation, frames: int, frames_per_second: float | int):
        self.moving = moving
        self.frames = frames
        self.frames_per_second = frames_per_second

    def save(self, path: str | Path) -> None:
        """Write the animation to a `.gif`, or to a page `.html` in which it can be stopped and moved by hand.

        Raises: ValueError for another kind of file."""
        path = Path(path)
        if path.suffix not in {".gif", ".html"}:
            raise ValueError(f"`path` must end in .gif or .html, but is {path.name}.")
        # Matplotlib declares a whole number, and takes any. What rounding makes a little less than a hundredth of a
        # second would be cut down to the one before.
        pace: Any = self.frames_per_second * (1 - 1e-9)
        if path.suffix == ".gif":
            self.moving.save(path, writer=PillowWriter(fps=pace))
        else:
            path.write_text(self.moving.to_jshtml(fps=pace))

    def __repr__(self) -> str:
        return f"Animation of {self.frames} frames, {self.frames_per_second:g} a second: `.save('motion.gif')`"

    def _repr_html_(self) -> str:
        """What a notebook shows: the GIF itself, which the notebook keeps."""
        with tempfile.TemporaryDirectory() as folder:
            self.save(Path(folder) / "motion.gif")
            data = base64.b64encode((Path(folder) / "motion.gif").read_bytes()).decode()
        return f"<img src='data:image/gif;base64,{data}' alt='the motion'>"


def animate(
    scene: AbstractScene,
    trajectory: Trajectory,
    draw: Callable[[Any], Sequence] | None = None,
    *,
    frames_per_second: float | int = 25.0,
    speed: float | int = 1.0,
    size: tuple[float | int, float | int] = (5.0, 4.0),
) -> Animation:
    """A moving picture of a planar scene.

    Arguments:

    - `scene`, `trajectory`: what moved, and its motion with samples (`ts=`), at least as dense as the frames.
    - `draw`: `draw(q)` or, for what moves by itself, `draw(q, t)` returns the outlines of all bodies at one instant, a
      list of as many at each: arrays (point, 2) in metres, closed ones with their first point again at the end, such as
      `hybridsens.planar.circle(...)`. An argument behind these needs a default. Default: the scene's own method `draw`.
    - `frames_per_second`, `speed`: of the picture; speed 0.5 shows the motion at half its pace. A GIF counts in
      hundredths of a second, and is shown slowly where a frame lasts but one: a frame takes the nearest whole number
      of them from 2 on.
    - `size`: of the picture, in inches.

    Each frame shows the sample that is nearest to its time. A motion that broke off is shown as far as it came.
    Raises: ValueError without samples, or where the motion reached none; without outlines; for more than 600 frames, or
    a pace that is not positive; TypeError for what is no motion of a scene.
    """
    ts, q = _reached(*must_be_sampled(trajectory))
    outlines = _outlines(scene, draw)
    for name, value in (("frames_per_second", frames_per_second), ("speed", speed)):
        if not 0 < value < np.inf:
            raise ValueError(f"`{name}` must be a positive number, but is {value!r}.")
    frames_per_second = 100 / max(round(100 / frames_per_second), 2)
    count = int(np.ceil((ts[-1] - ts[0]) / speed * frames_per_second)) + 1
    if count > MOST_FRAMES:
        raise ValueError(f"An animation has {MOST_FRAMES} frames at most, but this one has {count}: raise `speed`.")
    times = np.linspace(ts[0], ts[-1], count)
    nearest = np.abs(ts[None, :] - times[:, None]).argmin(axis=1)
    frames = [_bodies(outlines(q[k], ts[k])) for k in nearest]
    if len({len(bodies) for bodies in frames}) > 1:
        raise ValueError("`draw` must return as many outlines at each instant, but returns more at one than another.")
    return Animation(_moving(frames, ts[nearest], size, 1000 / frames_per_second), count, frames_per_second)


def _bodies(outlines: Any) -> list[np.ndarray]:
    """The outlines at one instant. Raises: ValueError where they are no list of arrays (point, 2)."""
    shapes = [np.shape(body) for body in outlines]
    if not shapes or any(len(shape) != 2 or shape[1] != 2 for shape in shapes):
        raise ValueError(
            "`draw` must return a list of outlines, arrays of shape (point, 2), with one at least, but returns "
            f"{'one array' if hasattr(outlines, 'shape') else f'a {type(outlines).__name__}'} of entries of the shapes "
            f"{sorted(set(shapes))}: put a single outline into a list."
        )
    return [np.asarray(body) for body in outlines]


def _reached(ts, q):
    """The samples that the motion came to; those after its end are nan."""
    there = np.all(np.isfinite(q), axis=1)
    if not np.any(there):
        raise ValueError(
            f"`trajectory` must have reached one of its samples to be shown, but broke off before t = {ts[0]:g}: look "
            "at its `status`, or give `ts` earlier times."
        )
    return ts[there], q[there]


def _moving(frames, times, size, interval: float) -> FuncAnimation:
    figure = Picture(figsize=size, layout="constrained")
    axes = figure.subplots()
    _frame_axes(axes, np.concatenate([body for bodies in frames for body in bodies]))
    lines = [axes.plot([], [], color=COLOURS[i % len(COLOURS)], linewidth=2)[0] for i in range(len(frames[0]))]
    clock = axes.set_title("", loc="left", family="monospace", fontsize="small")  # above the bodies, never on them

    def show(k: int):
        for line, body in zip(lines, frames[k], strict=True):
            line.set_data(body[:, 0], body[:, 1])
        clock.set_text(f"t = {times[k]:.2f} s")
        return [*lines, clock]

    show(0)
    figure.draw_without_rendering()
    figure.set_layout_engine("none")  # laid out once: a layout for each frame would let the axes tremble
    return FuncAnimation(figure, show, frames=len(frames), interval=interval, blit=False)


def _frame_axes(axes: Axes, points) -> None:
    """Equal axes that hold all that is ever drawn."""
    low, high = points.min(axis=0), points.max(axis=0)
    margin = 0.05 * max(*(high - low), 1e-9)
    axes.set_xlim(low[0] - margin, high[0] + margin)
    axes.set_ylim(low[1] - margin, high[1] + margin)
    axes.set_aspect("equal")
    axes.set_xlabel("x [m]")
    axes.set_ylabel("y [m]")


def _outlines(scene: Any, draw: Callable | None) -> Callable:
    """(q, t) -> outlines, from a function of q or of both."""
    draw = getattr(scene, "draw", None) if draw is None else draw
    if draw is None:
        raise ValueError(
            f"`draw` must be given for a {type(scene).__name__}, or be a method of it: draw(q) -> outlines, arrays "
            "(point, 2)."
        )
    further = list(inspect.signature(draw).parameters.values())[1:]
    takes_time = any(one.default is one.empty or one.name == "t" for one in further[:1])  # draw(q, radius=1.0) does not
    return draw if takes_time else lambda q, t: draw(q)
