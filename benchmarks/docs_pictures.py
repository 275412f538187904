"""The pictures of the documentation. Run as `python -m benchmarks.docs_pictures`; it writes docs/images."""

import re
from pathlib import Path

import jax.numpy as jnp
import numpy as np
from matplotlib.figure import Figure

import hybridsens as hs

DOCS = Path(__file__).parents[1] / "docs"
DARK, RED = "#14213d", "#c8553d"


def first_motion():
    """The ball of the first page."""
    ball = hs.scenes.BouncingBall(height=1.0, restitution_coefficient=0.8)
    motion = hs.simulate(ball, ball.initial_state(), t1=1.5, ts=jnp.linspace(0.0, 1.5, 151))
    hs.plot_trajectory(ball, motion).savefig(DOCS / "images" / "first_motion.png", dpi=90)


def life_of_a_contact():
    """A mass slides off a cylinder, flies and bounces: what the contact does at each time."""
    scene = hs.scenes.CylinderSlide(depth=1.0, angle=0.3)
    motion = hs.simulate(scene, scene.initial_state(), t1=1.6, ts=jnp.linspace(0.0, 1.6, 321))
    figure = Figure(figsize=(7, 4.2), layout="constrained")
    axes = figure.subplots()
    angle = np.linspace(0, 2 * np.pi, 200)
    axes.fill(np.cos(angle), np.sin(angle), color="0.9")
    axes.fill_between([-1.2, 3.4], -1.0, -1.3, color="0.9")
    t, release = np.asarray(motion.ts), float(motion.events.time[0])
    held = t <= release
    axes.plot(*motion.q[held].T, color=DARK, linewidth=3, label="closed: the contact pushes, and holds the mass")
    axes.plot(*motion.q[~held].T, color=DARK, linewidth=1, label="open: the mass flies")
    n = int(motion.events.count)
    places = np.asarray(motion.events.after.q[:n])
    axes.plot(*places[0], "^", color="black", markerfacecolor="white", markersize=9, label="release")
    axes.plot(*places[1:].T, "v", color=RED, markersize=9, label="impact")
    axes.set_aspect("equal")
    axes.set_xlim(-1.2, 3.4)
    axes.set_ylim(-1.3, 1.5)
    axes.set_xlabel("x [m]")
    axes.set_ylabel("y [m]")
    axes.legend(frameon=False, fontsize="small", loc="upper right")
    figure.savefig(DOCS / "images" / "life_of_a_contact.png", dpi=90)


def shifted_impact():
    """A bounce and the same from a little higher: the second comes late, and between both impacts they differ."""
    figure = Figure(figsize=(7, 3), layout="constrained")
    axes = figure.subplots(1, 2)
    ts = jnp.linspace(0.3, 0.62, 641)
    for height, colour, style, label in ((1.0, DARK, "-", "from 1.00 m"), (1.08, RED, "--", "from 1.08 m")):
        ball = hs.scenes.BouncingBall(height=height)
        motion = hs.simulate(ball, ball.initial_state(), t1=0.62, ts=ts)
        axes[0].plot(ts, motion.q[:, 0], style, color=colour, label=label)
        axes[1].plot(ts, motion.v[:, 0], style, color=colour)
        impact = float(motion.events.time[0])
        for one in axes:
            one.axvline(impact, color=colour, linewidth=0.7, linestyle=style)
    axes[0].set_ylabel("height [m]")
    axes[1].set_ylabel("velocity [m/s]")
    axes[0].legend(frameon=False, fontsize="small")
    for one in axes:
        one.set_xlabel("time [s]")
    figure.savefig(DOCS / "images" / "shifted_impact.png", dpi=90)


def contacts():
    """Forces and impulses of the mass on the cylinder."""

    class Slide(hs.scenes.CylinderSlide):
        contacts = ("cylinder", "floor")

    scene = Slide()
    motion = hs.simulate(scene, scene.initial_state(), t1=scene.t1, ts=jnp.linspace(0.0, scene.t1, 251))
    hs.plot_contacts(scene, motion).savefig(DOCS / "images" / "contacts.png", dpi=90)


def cart():
    """The moving picture of the page on energies, by the code of that page."""
    blocks = re.findall(r"```python\n(.*?)```", (DOCS / "energies.md").read_text(), re.DOTALL)
    names: dict = {}
    exec("\n".join(blocks[:1]).replace("hs.configure()", ""), names)
    moving = hs.animate(names["scene"], names["motion"], frames_per_second=20, size=(5, 3))
    moving.save(DOCS / "images" / "cart.gif")


def map_of_a_sweep():
    """Where an elastic stop gains and loses impacts, over the force that drives it."""
    grid = {"amplitude": np.linspace(0.5, 1.5, 160), "frequency": np.linspace(1.0, 2.0, 160)}

    def cost(scene):
        square = lambda scene, t, q, v: q @ q
        motion = hs.simulate(scene, scene.initial_state(), t1=20.0, running_cost=square, max_events=32, throw=False)
        return motion.cost, motion

    units = {"amplitude": "N", "frequency": "rad/s", "J": "m2 s"}
    found = hs.sweep(cost, hs.grid(hs.scenes.ElasticStop(), grid), units=units)
    hs.plot_sweep(found).savefig(DOCS / "sweep-map.png", dpi=90)


def main():
    hs.configure()
    for draw in (first_motion, life_of_a_contact, shifted_impact, contacts, cart, map_of_a_sweep):
        draw()
        print(draw.__name__)


if __name__ == "__main__":
    main()
