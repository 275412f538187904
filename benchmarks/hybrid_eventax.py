"""What does a network's gradient by its weights cost here and with eventax's EventProp, at which error?

    python -m benchmarks.hybrid_eventax                # one neuron, and a layer of 20
    python -m benchmarks.hybrid_eventax --lanes 100    # a batch of layers too

The cost is the sum of all spike times, its gradient by weights and drive. One run on one core, by turns, the shortest
of many calls; errors are relative to the largest entry of our gradient at tolerance 1e-12. Rows also go to
results/hybrid_eventax.csv.
"""

import argparse
import json
import time

import hybridsens as hs

from .hybrid_cost import shortest
from .machine import describe
from .peers import eventax_neurons
from .rows import show, write

EVENTAX = {
    "eventax Tsit5 0.1, EventProp": eventax_neurons.Setting("Tsit5", 0.1, "EventProp"),
    "eventax Euler 0.05, EventProp": eventax_neurons.Setting("Euler", 0.05, "EventProp"),
}
TOLERANCES = (1e-9, 1e-5)


def networks() -> dict:
    """Name -> the neurons, their horizon, and how many events there may be."""
    import jax.numpy as jnp
    import numpy as np

    draw = np.random.default_rng(0)
    times = lambda count, end: jnp.array(np.sort(draw.uniform(0.5, end, count)))
    lone = hs.systems.Neurons(
        jnp.zeros((1, 1)), jnp.array(draw.uniform(0.8, 2.2, (1, 14))), times(14, 34.0), jnp.array([0.2]), 9.0, 4.0, 0.5
    )
    layer = hs.systems.Neurons(
        jnp.zeros((20, 20)), jnp.array(draw.uniform(0.0, 1.6, (20, 20))), times(20, 26.0), jnp.zeros(20), 9.0, 4.0, 1.0
    )
    return {"one neuron": (lone, 40.0, 64), "layer of 20": (layer, 30.0, 256)}


def ours(neurons, horizon: float, room: int, tolerance: float):
    """Sum of spike times by (weights of neurons and inputs as rows, drive), and how many there are."""
    import equinox as eqx
    import jax.numpy as jnp

    count = neurons.drive.shape[0]
    places = lambda n: (n.weights, n.input_weights, n.drive)

    def cost(weights, drive):
        system = eqx.tree_at(places, neurons, (weights[:count].T, weights[count:].T, drive))
        made = hs.solve(
            system, system.initial_state(), t1=horizon, rtol=tolerance, atol=tolerance, max_events=room, throw=False
        ).events
        spikes = (made.guard >= 0) & (made.guard < count)
        return jnp.sum(jnp.where(spikes, made.time, 0.0)), jnp.sum(spikes)

    return cost


def contestants(neurons, horizon, room) -> dict:
    """Name -> cost(weights, drive), with the number of spikes beside it."""
    import jax.numpy as jnp

    costs = {f"hybridsens {tolerance:.0e}": ours(neurons, horizon, room, tolerance) for tolerance in TOLERANCES}
    if eventax_neurons.available() is not None:
        print(eventax_neurons.available())
        return costs
    for name, setting in EVENTAX.items():
        made, inputs = eventax_neurons.network(neurons, horizon, setting, room)
        run = lambda w, d, made=made, inputs=inputs: eventax_neurons.spike_times(made, inputs, w, d, horizon, room)
        costs[name] = lambda w, d, run=run: (run(w, d), jnp.zeros(()))
    return costs


def rows(name: str, neurons, horizon: float, room: int, lanes: int | None) -> list[dict]:
    """One row for each contestant; with `lanes`, of a batch of weights within 1 %."""
    import jax
    import jax.numpy as jnp
    import numpy as np

    weights = jnp.concatenate([neurons.weights.T, neurons.input_weights.T])
    drive = neurons.drive
    if lanes:
        weights = weights * (1 + 0.01 * jax.random.uniform(jax.random.key(1), (lanes, *weights.shape), minval=-1.0))
    vectorize = (lambda f: jax.vmap(f, in_axes=(0, None))) if lanes else (lambda f: f)
    differentiate = lambda f: jax.jit(vectorize(jax.value_and_grad(f, argnums=(0, 1), has_aux=True)))
    exact = differentiate(ours(neurons, horizon, room, 1e-12))(weights, drive)
    calls, errors, compiling = {}, {}, {}
    for who, cost in contestants(neurons, horizon, room).items():
        start = time.perf_counter()
        gradient = differentiate(cost).lower(weights, drive).compile()
        compiling[who] = time.perf_counter() - start
        forward = jax.jit(vectorize(cost)).lower(weights, drive).compile()
        calls[who] = lambda run=gradient: jax.block_until_ready(run(weights, drive))
        calls[f"{who} forward"] = lambda run=forward: jax.block_until_ready(run(weights, drive))
        found = calls[who]()[1]
        calls[f"{who} forward"]()
        pairs = zip(jax.tree.leaves(found), jax.tree.leaves(exact[1]), strict=True)
        largest = max(float(jnp.abs(leaf).max()) for leaf in jax.tree.leaves(exact[1]))
        errors[who] = max(float(np.abs(a - b).max()) for a, b in pairs) / largest
    taken = shortest(calls, seconds=20.0)
    spikes = float(np.mean(exact[0][1]))
    return [
        {
            "what": name if lanes is None else f"{name}, {lanes} lanes", "who": who, "spikes": spikes,
            "gradient_error": error, "forward_us": taken[f"{who} forward"] * 1e6, "gradient_us": taken[who] * 1e6,
            "gradient/forward": taken[who] / taken[f"{who} forward"], "per_s": (lanes or 1) / taken[who],
            "compile_s": compiling[who],
        }
        for who, error in errors.items()
    ]  # fmt: skip


def main() -> None:
    """Run and print; write the rows with the machine and the versions beside them."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--lanes", type=int, help="a batch of layers of so many samples too")
    parser.add_argument("--only", choices=("one neuron", "layer of 20"))
    arguments = parser.parse_args()
    hs.configure()
    print(json.dumps(describe()))
    found = []
    for name, given in networks().items():
        if arguments.only in (None, name):
            found += [show(row) for row in rows(name, *given, None)]
    if arguments.lanes:
        found += [show(row) for row in rows("layer of 20", *networks()["layer of 20"], arguments.lanes)]
    write("hybrid_eventax", found)


if __name__ == "__main__":
    main()
