"""What does one event cost at 1, 20 and 100 coordinates; and what a network of 100 neurons with 1000 spikes?

    python -m benchmarks.hybrid_scale

An event's own cost is the slope of a motion's time by its number of events, its steps and coordinates being the same:
a clock of more or fewer ticks in one horizon, with steps no longer than the shortest tick. Beside it stands that of one
step. The network is all to all; its time, its memory (what the compiler plans) and the cost of each event are stated.
One core, shortest of many calls. Rows also go to results/hybrid_scale.csv.
"""

import argparse
import json
import time

import equinox as eqx
from jaxtyping import Array, Float

import hybridsens as hs

from .hybrid_cost import shortest
from .machine import describe
from .rows import show, write


class Ring(hs.AbstractHybridSystem):
    """x' = coupling (roll(x) - x), and a clock that turns x once at every tick; the mode counts the ticks."""

    coupling: Float[Array, ""]
    period: Float[Array, ""]
    guard_count: int = eqx.field(static=True)

    def flow(self, t, x, mode):
        import jax.numpy as jnp

        return self.coupling * (jnp.roll(x, 1) - x)

    def guards(self, t, x, mode):
        """The clock, and guards that never fall."""
        import jax.numpy as jnp

        tick = (mode + 1) * self.period - t
        return jnp.concatenate([tick[None], 1e3 + x[: self.guard_count - 1]])

    def transition(self, event, t, x, mode):
        import jax.numpy as jnp

        return 0.99 * jnp.roll(x, 1), mode + 1


def ring_row(coordinates: int, guards: int) -> dict:
    """Cost of an event and of a step, forward and with the gradient, of one ring."""
    import jax
    import jax.numpy as jnp

    room, steps, few, many = 128, 1024, 4, 104
    x0 = jnp.linspace(0.0, 1.0, coordinates)

    def run(ticks, step):
        system = Ring(jnp.array(0.5), 10.0 / (ticks + 0.5), guards)
        made = hs.solve(system, x0, jnp.array(0), t1=10.0, max_step=step, max_events=room, max_steps=steps, throw=False)
        return jnp.sum(made.final), (made.events.count, made.steps.accepted + made.steps.rejected)

    compiled = {"forward": jax.jit(run), "gradient": jax.jit(jax.value_and_grad(run, has_aux=True))}
    at = {"few": (few + 0.0, 0.05), "many": (many + 0.0, 0.05), "fine": (few + 0.0, 0.025)}
    calls = {
        f"{kind} {place}": lambda run=run, given=given: jax.block_until_ready(run(*given))
        for kind, run in compiled.items()
        for place, given in at.items()
    }
    counts = {place: compiled["forward"](*given)[1] for place, given in at.items()}
    for call in calls.values():
        call()
    taken = shortest(calls, seconds=4.0)
    row = {"what": "one event", "coordinates": coordinates, "guards": guards}
    for kind in compiled:
        step = (taken[f"{kind} fine"] - taken[f"{kind} few"]) / float(counts["fine"][1] - counts["few"][1])
        more = taken[f"{kind} many"] - taken[f"{kind} few"] - step * float(counts["many"][1] - counts["few"][1])
        events = float(counts["many"][0] - counts["few"][0])
        row |= {f"{kind}_event_us": more / events * 1e6, f"{kind}_step_us": step * 1e6}
    return row


def network_row(count: int, spikes: int) -> dict:
    """An all-to-all network that runs until about so many spikes: time and memory of the gradient by all weights."""
    import jax
    import jax.numpy as jnp
    import numpy as np

    draw = np.random.default_rng(0)
    weights = jnp.array(draw.normal(0.0, 0.3 / np.sqrt(count), (count, count)))
    drive = jnp.array(draw.uniform(1.2, 2.0, count))
    neurons = hs.systems.Neurons(weights, jnp.zeros((count, 0)), jnp.zeros(0), drive, 10.0, 5.0, 1.0)
    horizon = 11.0 * spikes / count

    def cost(neurons):
        made = hs.solve(
            neurons, neurons.initial_state(), t1=horizon, max_events=int(1.5 * spikes), max_steps=16 * spikes,
            throw=False,
        )  # fmt: skip
        used = jnp.arange(made.events.time.shape[0]) < made.events.count
        return jnp.sum(jnp.where(used, made.events.time, 0.0)), (made.events.count, made.steps.accepted, made.status)

    forward = jax.jit(cost).lower(neurons).compile()
    start = time.perf_counter()
    gradient = jax.jit(jax.value_and_grad(cost, has_aux=True)).lower(neurons).compile()
    compile_seconds = time.perf_counter() - start
    (_, (events, steps, status)), _ = gradient(neurons)
    calls = {
        "forward": lambda: jax.block_until_ready(forward(neurons)),
        "gradient": lambda: jax.block_until_ready(gradient(neurons)),
    }
    taken, plan = shortest(calls, seconds=10.0), gradient.memory_analysis()
    return {
        "what": "network", "neurons": count, "spikes": int(events), "steps": int(steps), "status": int(status.code),
        "forward_ms": taken["forward"] * 1e3, "gradient_ms": taken["gradient"] * 1e3,
        "gradient/forward": taken["gradient"] / taken["forward"],
        "forward_us_per_spike": taken["forward"] / int(events) * 1e6,
        "plan_MB": (plan.temp_size_in_bytes + plan.output_size_in_bytes) / 1e6, "compile_s": compile_seconds,
    }  # fmt: skip


def main() -> None:
    """Run and print; write the rows with the machine and the versions beside them."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--spikes", type=int, default=1000)
    spikes = parser.parse_args().spikes
    hs.configure()
    print(json.dumps(describe()))
    rows = [show(ring_row(n, guards)) for n, guards in ((1, 1), (20, 1), (100, 1), (20, 20), (100, 100))]
    rows += [show(network_row(count, spikes * count // 100)) for count in (10, 30, 100)]
    write("hybrid_scale", rows)


if __name__ == "__main__":
    main()
