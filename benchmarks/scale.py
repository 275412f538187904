"""How cost grows with coordinates and contacts, beside hand-written compiled code for one scene.

    python -m benchmarks.scale                    # the chain of masses, link pendulums, balls in a box, many gaps
    python -m benchmarks.scale --chain 8 64       # the chain alone, of so many masses
    python -m benchmarks.scale --small-loop-bytes 2147483647    # under the setting for hundreds of coordinates

Ours and numba's are timed in turn on one core, the least of several times each; a first call is that of value and
gradient, tracing and compilation included.
"""

import argparse
import time

import hybridsens as hs

from .machine import describe, one_core
from .peers.numba_chain_adjoint import Chain
from .rows import show, write

CHAIN, LINKS, GAPS = (1, 2, 4, 8, 16, 64, 256), (4, 8, 16), (10, 1000)
BALLS, COLLISIONS = 20, 200


def compiled(scene, t1, max_steps, max_events):
    """int |q|^2 and what is said of the motion; the same with its gradient by every parameter."""
    import jax

    def cost(scene):
        motion = hs.simulate(
            scene, scene.initial_state(), t1=t1, running_cost=lambda s, t, q, v: q @ q,
            max_steps=max_steps, max_events=max_events, throw=False,
        )  # fmt: skip
        return motion.cost, (motion.status, motion.events.count, motion.steps, motion.final)

    return jax.jit(cost), jax.jit(jax.value_and_grad(cost, has_aux=True))


def least(function, *arguments, seconds: float = 2.0) -> float:
    """Seconds of the quickest call of many, the first one apart."""
    import jax

    jax.block_until_ready(function(*arguments))
    best, start = float("inf"), time.perf_counter()
    while time.perf_counter() - start < seconds:
        begin = time.perf_counter()
        jax.block_until_ready(function(*arguments))
        best = min(best, time.perf_counter() - begin)
    return best


def measured(scene, t1, max_steps, max_events) -> dict:
    """Times of one scene; its motion must be successful."""
    value, gradient = compiled(scene, t1, max_steps, max_events)
    start = time.perf_counter()
    (J, (status, events, steps, _)), _ = gradient(scene)
    float(J)
    first = time.perf_counter() - start
    assert status == hs.Status.successful, hs.Status[status]
    forward, backward = least(value, scene), least(gradient, scene)
    return {
        "J": float(J), "events": int(events), "steps": int(steps.accepted), "rejected": int(steps.rejected),
        "first call [s]": first, "forward [ms]": forward * 1e3, "gradient [ms]": backward * 1e3,
        "gradient / forward": backward / forward,
    }  # fmt: skip


def chain(count: int) -> dict:
    """The chain of masses beside numba."""
    scene = hs.scenes.ChainOfMasses(count)
    ours = measured(scene, scene.t1, 2048 + 64 * count, 50 + 12 * count)
    peer = Chain(count)
    peer.gradient()
    forward, backward = least(peer.value) * 1e3, least(peer.gradient) * 1e3
    return {
        "scene": "chain", "size": count, **ours, "numba forward [ms]": forward, "numba gradient [ms]": backward,
        "forward / numba": ours["forward [ms]"] / forward, "gradient / numba": ours["gradient [ms]"] / backward,
        "J off numba's": abs(ours["J"] / peer.value()[0] - 1),
    }  # fmt: skip


def links(count: int) -> dict:
    """A pendulum of n links beside a wall."""
    scene = hs.scenes.LinkPendulum(count)
    return {"scene": "links", "size": count, **measured(scene, 1.0, 8192, 512)}


def balls() -> dict:
    """Balls in a box: energy after many collisions."""
    scene = hs.scenes.BallsInBox(BALLS)
    value, _ = compiled(scene, 12.0, 8192, COLLISIONS)
    status, events, _, final = value(scene)[1]
    energy = lambda state: float((scene.mass_matrix(state.q).mv(state.v)) @ state.v)
    drift = abs(energy(final) / energy(scene.initial_state()) - 1)
    seconds = least(value, scene)
    return {
        "scene": "balls", "size": BALLS, "events": int(events), "status": hs.Status[status][:30],
        "forward [ms]": seconds * 1e3, "energy drift": drift,
    }  # fmt: skip


def gaps(count: int) -> dict:
    """One body of two coordinates that falls into a bowl of flat walls."""
    import jax
    import jax.numpy as jnp
    import numpy as np

    class Bowl(hs.AbstractScene):
        weight: jax.Array

        def initial_state(self):
            return hs.State([0.1, 0.2], [0.3, 0.0])

        def mass_matrix(self, q):
            return jnp.eye(2)

        def force(self, t, q, v):
            return jnp.stack([jnp.zeros_like(self.weight), -self.weight])

        def gap(self, t, q):
            around = 2 * np.pi * (np.arange(count) + 0.5) / count
            return 1 - np.cos(around) * q[0] - np.sin(around) * q[1]

        def restitution(self):
            return jnp.full(count, 0.9)

    return {"scene": "gaps", "size": count, **measured(Bowl(jnp.array(9.81)), 2.0, 2048, 64)}


def main() -> None:
    """Show and write all rows, or those of the chain that are asked for."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--chain", type=int, nargs="*", help="masses of the chains, in place of everything")
    parser.add_argument("--small-loop-bytes", type=int, default=16_777_216, help="see hybridsens.configure")
    given = parser.parse_args()
    asked = given.chain
    hs.configure(small_loop_bytes=given.small_loop_bytes)
    print(describe())
    with one_core():
        rows = [show(chain(count)) for count in (CHAIN if asked is None else asked)]
        if asked is None:
            rows += [show(links(count)) for count in LINKS]
            rows += [show(gaps(count)) for count in GAPS]
            rows.append(show(balls()))
            write("scale", rows)


if __name__ == "__main__":
    main()
