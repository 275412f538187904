"""Pictures of a motion: gaps, velocities and contacts over time, single coordinates."""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from ..export.names import contact_names, coordinate_names, names_of_events, split_unit, unit_of_contact
from ..mechanics.contact import Instant, gap_and_rate
from ..mechanics.mode import EventKind
from ..mechanics.scene import AbstractScene
from ..mechanics.trajectory import Trajectory
from .figure import COLOURS, legend_above, line, must_be_sampled, new_figure
from .held import closed_contacts

MOST = 16
"""Of more contacts only some are drawn."""

_MARKS = {
    EventKind.IMPACT: ("v", "black"),
    EventKind.CAPTURE: ("s", "0.6"),
    EventKind.RELEASE: ("^", "white"),
}


def plot_trajectory(scene: AbstractScene, trajectory: Trajectory, axes: list[Axes] | None = None) -> Figure:
    """Gaps with their events, velocities, and the times at which each contact is closed, over time. Switches of the
    scene are dotted lines.

    Arguments: the scene that moved; its trajectory with samples (`ts=`), which should be dense; three axes to draw in,
    from top to bottom, or None for a new figure.
    Returns: the figure. Raises: ValueError if the trajectory has no samples or is a batch.
    """
    must_be_sampled(trajectory)
    t, q, v, _ = with_events(trajectory)
    gaps = np.asarray(jax.vmap(lambda t, q, v: gap_and_rate(scene, t, q, v)[0])(jnp.asarray(t), q, v))
    contacts, (_, rates) = contact_names(scene, gaps.shape[1]), coordinate_names(scene, q.shape[1])
    shown = contacts_shown(trajectory)
    if axes is None:
        rows = max(4, len(shown)) / 4
        figure = new_figure((8, 5 + rows))
        axes = list(figure.subplots(3, 1, sharex=True, height_ratios=[3, 3, rows]))
    draw_lines(axes[0], t, gaps, f"gap{unit_of_contact(scene, 'm')}", _labels(scene, "contacts", contacts), shown)
    _draw_events(axes[0], trajectory)
    _draw_switches(axes[:2], scene, trajectory)
    velocities = _labels(scene, "coordinates", rates) or ["velocity"]
    name = velocities[0] if len(velocities) == 1 else _with_common_unit("velocity", velocities)
    draw_lines(axes[1], t, np.asarray(v), name, velocities if len(velocities) == v.shape[1] else None)
    closed = np.asarray(eqx.filter_jit(closed_contacts)(scene, Instant(jnp.asarray(t), q, v)))
    _draw_closed(axes[2], t, closed, trajectory, shown)
    axes[2].set_yticks(range(len(shown)), [contacts[i] for i in shown])
    if len(shown) < len(contacts):
        axes[0].set_title(f"{len(shown)} of {len(contacts)} contacts", loc="left", fontsize="small")
    axes[2].set_xlabel("time [s]")
    return axes[0].get_figure(root=True)  # type: ignore[return-value]


def _with_common_unit(name: str, columns: list[str]) -> str:
    """The name with the unit of all columns, where they have one."""
    units = {split_unit(column)[1] for column in columns}
    unit = units.pop()
    return name if units or unit is None else f"{name} [{unit}]"


def contacts_shown(trajectory: Trajectory) -> list[int]:
    """Numbers of the contacts that are drawn: all, or of many those with an event, and those closed at the end."""
    count = trajectory.events.impulse.shape[-1]
    if count <= MOST:
        return list(range(count))
    kind, contact = np.asarray(trajectory.events.kind), np.asarray(trajectory.events.contact)
    struck = contact[(kind >= 0) & (kind != EventKind.SWITCH)].tolist()
    met = dict.fromkeys([*struck, *np.flatnonzero(trajectory.mode).tolist()])
    return sorted((list(met) or range(count))[:MOST])


def _labels(scene: AbstractScene, named_by: str, names: list[str]) -> list[str] | None:
    """Names that the scene gives; None for those that would be numbers."""
    return names if getattr(scene, named_by, None) is not None else None


def with_events(trajectory: Trajectory):
    """Samples up to the end of the motion, with the states just before and just after every event among them in the
    order of time; and how many events have passed."""
    events, count = trajectory.events, int(trajectory.events.count)
    time, reached = events.time[:count], np.isfinite(np.asarray(trajectory.q)).all(1)
    ts = np.asarray(trajectory.ts)[reached]
    t = np.concatenate([time, time, ts])  # sorting is stable: before, after, sample
    order = np.argsort(t, kind="stable")
    both = lambda before, after, samples: jnp.concatenate([before[:count], after[:count], samples[reached]])[order]
    q = both(events.before.q, events.after.q, trajectory.q)
    by_sample = np.searchsorted(time, ts, side="right")
    passed = np.concatenate([np.arange(count), np.arange(count) + 1, by_sample])
    return t[order], q, both(events.before.v, events.after.v, trajectory.v), passed[order]


def draw_lines(axes: Axes, t, values, name: str, labels: list[str] | None = None, shown: list[int] | None = None):
    """A line for each column, or for those `shown`."""
    several = values.shape[1] > 1
    labels = labels or [f"{split_unit(name)[0]} {i}" for i in range(values.shape[1])]
    for number, i in enumerate(range(values.shape[1]) if shown is None else shown):
        axes.plot(t, values[:, i], **line(number), linewidth=1.4, label=labels[i] if several else None)
    axes.set_ylabel(name)
    axes.axhline(0, color="0.7", linewidth=0.8, zorder=0)
    legend_above(axes)


def _draw_events(axes: Axes, trajectory: Trajectory) -> None:
    """A mark at gap 0 for each event, one shape for each kind, below the line that it belongs to."""
    happened = np.asarray(trajectory.events.kind)
    time = np.asarray(trajectory.events.time)
    for kind, (marker, face) in _MARKS.items():
        at = time[happened == kind]
        if at.size:
            label = f"{kind.name.lower()} ({at.size})"
            axes.plot(at, np.zeros_like(at), marker, markerfacecolor=face, color="black", markersize=6, label=label)
    legend_above(axes)


def _draw_switches(panels: list[Axes], scene: AbstractScene, trajectory: Trajectory) -> None:
    """A dotted line where a switch of the scene fell, and the name of each switch beside the marks of other events."""
    events = trajectory.events
    switched = np.asarray(events.kind) == EventKind.SWITCH
    number, time = np.asarray(events.contact)[switched], np.asarray(events.time)[switched]
    styles = [":", (0, (1, 3)), (0, (4, 2, 1, 2)), (0, (1, 1))]
    for i in np.unique(number):
        at = time[number == i]
        (name,) = names_of_events(scene, [i], [True], events.impulse.shape[-1])
        name = f"switch {name}" if name == str(i) else name
        for axes in panels:
            lines = axes.vlines(at, 0, 1, transform=axes.get_xaxis_transform(), color="0.4", linewidth=1.0)
            lines.set_linestyle(styles[i % len(styles)])
            lines.set_label(f"{name} ({at.size})" if axes is panels[0] else "")
    if switched.any():
        legend_above(panels[0])


def _draw_closed(axes: Axes, t, closed, trajectory: Trajectory, shown: list[int]) -> None:
    """One row for each contact: a bar while its gap is closed, a tick at each of its events."""
    contact, time = np.asarray(trajectory.events.contact), np.asarray(trajectory.events.time)
    contact = np.where(np.asarray(trajectory.events.kind) == EventKind.SWITCH, -1, contact)
    for row, i in enumerate(shown):
        held = closed[:-1, i] & closed[1:, i]
        axes.broken_barh([(t[k], t[k + 1] - t[k]) for k in np.flatnonzero(held)], (row - 0.3, 0.6), color="0.55")
        axes.vlines(time[contact == i], row - 0.4, row + 0.4, color="black", linewidth=0.9)
    if not closed[:, shown].any() and not np.isin(contact, shown).any():
        axes.text(0.5, 0.5, "none", transform=axes.transAxes, ha="center", va="center", color="0.4")
    axes.set_ylim(len(shown) - 0.4, -0.6)
    axes.set_ylabel("closed\ncontact")


def plot_coordinates(scene: AbstractScene, trajectory: Trajectory) -> Figure:
    """Each coordinate and its velocity over time, by the names of `scene.coordinates`; events are thin vertical lines.

    Arguments: the scene that moved; its trajectory with samples (`ts=`), which should be dense.
    Returns: a figure with a row for each coordinate. Raises: ValueError without samples, or for a batch.
    """
    must_be_sampled(trajectory)
    t, q, v, _ = with_events(trajectory)
    dof = q.shape[1]
    figure = new_figure((9, 1.2 + 1.7 * dof))
    rows = figure.subplots(dof, 2, sharex=True, squeeze=False)
    times = np.asarray(trajectory.events.time[: int(trajectory.events.count)])
    for i, names in enumerate(zip(*coordinate_names(scene, dof), strict=True)):
        for axes, values, name in zip(rows[i], (q, v), names, strict=True):
            axes.plot(t, np.asarray(values[:, i]), color=COLOURS[0], linewidth=1.4)
            axes.set_ylabel(name)
            for time in times:
                axes.axvline(time, color="0.8", linewidth=0.7, zorder=0)
    for axes in rows[-1]:
        axes.set_xlabel("time [s]")
    return figure
