"""The picture of what contacts do: forces while they are held, impulses when they strike."""

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from matplotlib.figure import Figure

from ..export.names import contact_names, unit_of_contact
from ..mechanics.contact import Instant
from ..mechanics.scene import AbstractScene
from ..mechanics.switches import has_switches
from ..mechanics.trajectory import Trajectory
from .figure import legend_above, line, must_be_sampled, new_figure
from .held import held_forces
from .motion import contacts_shown, with_events


def contact_forces(scene: AbstractScene, trajectory: Trajectory):
    """Times, with those of events twice, and the force of each contact at them (time, contact): lambda of
    M v' = F + G lambda [N] where the contact is held closed, by Gauss's principle (T2) at that state, 0 where it is
    open. Of contacts that share a load in more than one way, as the four feet of a table, as many carry it as are
    independent.

    Arguments: the scene that moved, and its trajectory with samples. Raises: ValueError without samples, for a batch,
    or for a motion of a scene with switches that does not know its scene, as one that was loaded.
    """
    must_be_sampled(trajectory)
    t, q, v, passed = with_events(trajectory)
    modes = trajectory.modes_after(passed) if has_switches(scene) else None
    rows = Instant(jnp.asarray(t), q, v)
    return t, np.asarray(eqx.filter_jit(held_forces)(scene, rows, trajectory.mode, modes))


def plot_contacts(scene: AbstractScene, trajectory: Trajectory) -> Figure:
    """Forces of held contacts over time, where contacts may be held, and below them the impulse of each impact.

    Arguments: the scene that moved; its trajectory with samples (`ts=`), which should be dense.
    Returns: the figure. Raises: ValueError without samples, or for a batch.
    """
    t, forces = contact_forces(scene, trajectory)
    names = contact_names(scene, forces.shape[1])
    figure = new_figure((8, 4.5))
    panels = list(np.atleast_1d(figure.subplots(2 if scene.sustained_contact else 1, 1, sharex=True)))
    *held, below = panels
    events, n = trajectory.events, int(trajectory.events.count)
    shown = contacts_shown(trajectory)
    for number, i in enumerate(shown):
        style = line(number)
        label = f"contact {names[i]}"
        for above in held:
            above.plot(t, forces[:, i], **style, linewidth=1.4, label=label)
        impulse, time = np.asarray(events.impulse[:n, i]), np.asarray(events.time[:n])
        below.vlines(time[impulse != 0], 0, impulse[impulse != 0], **style, linewidth=1.6, label=label)
        below.plot(time[impulse != 0], impulse[impulse != 0], "o", color=style["color"], markersize=4)
    if len(shown) < len(names):
        below.set_title(f"{len(shown)} of {len(names)} contacts", loc="left", fontsize="small")
    for above in held:
        above.set_ylabel(f"force of held\ncontacts{unit_of_contact(scene, 'N')}")
        if not np.any(forces):  # an axis of its own choice would show as if something small were there
            above.set_yticks([0])
    below.set_ylabel(f"impulse of\nimpacts{unit_of_contact(scene, 'N s')}")
    below.set_xlabel("time [s]")
    below.set_ylim(bottom=0)
    legend_above(panels[0])
    return figure
