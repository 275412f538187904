"""MuJoCo MJX: sliding joints whose limits are the contacts, in fixed steps, differentiated by `jax.jacfwd`.

MuJoCo's contacts are soft. With the impedance near 1 a limit pushes with k Phi + b Phi', while that is repulsive; k
is chosen such that a free impact lasts `CONTACT_TIME`, b such that it rebounds with e. The solver is a `while_loop`,
which JAX differentiates in forward mode alone.
"""

import importlib.util
import time
from functools import partial

import numpy as np

from tests.problems import references

from . import reference

if importlib.util.find_spec("mujoco") is not None and importlib.util.find_spec("jax") is not None:
    import jax
    import jax.numpy as jnp

CONTACT_TIME = 0.01
STEPS_PER_SECOND = 5000

MODEL = """
<mujoco>
  <option timestep="{step}" integrator="Euler" iterations="4" ls_iterations="8"/>
  <compiler autolimits="false"/>
  <default><joint type="slide" axis="0 0 1" limited="true" margin="0"
    solimplimit="0.9999 0.9999 0.001" solreflimit="-1 -1"/></default>
  <worldbody>
    <body><joint name="q" range="-1000 1000"/><inertial pos="0 0 0" mass="1" diaginertia="1 1 1"/></body>
  </worldbody>
</mujoco>
"""

HORIZON = {"P1": 2.0, "P2": 20.0, "P2b": 20.0}


def available() -> str | None:
    """Why this peer cannot run here, or `None` if it can."""
    for package, module in (("mujoco", "mujoco"), ("mujoco-mjx", "mujoco.mjx"), ("jax", "jax")):
        try:
            found = importlib.util.find_spec(module)
        except ModuleNotFoundError:
            found = None
        if found is None:
            return f"{package} is not installed (pip install mujoco-mjx)"
    return None


def bouncing_ball(p):
    """P1, parameters q0 v0 g e: start, joint range, stiffness, damping, gravity, e and the force over time."""
    return (p[0], p[1]), (0.0, 1000.0), 0.0, 0.0, p[2], p[3], lambda t: 0.0


def elastic_stop(p):
    """P2 and P2b, parameters omega zeta A Omega d e."""
    forcing = lambda t: p[2] * jnp.cos(p[3] * t)
    return (0.0, 0.0), (-1000.0, p[4]), p[0] ** 2, 2 * p[0] * p[1], 0.0, p[5], forcing


PROBLEMS = {"P1": bouncing_ball, "P2": elastic_stop, "P2b": elastic_stop}


def spring(e):
    """MuJoCo's (-k, -b): half a period of the damped spring is `CONTACT_TIME`, and a free impact rebounds with e."""
    log_e = jnp.log(jnp.minimum(e, 0.999999))
    return -jnp.stack([(jnp.pi**2 + log_e**2) / CONTACT_TIME**2, -2 * log_e / CONTACT_TIME])


def model_of(problem: str):
    """The model on the device, with nominal numbers in the places that `cost` fills."""
    import mujoco
    from mujoco import mjx

    return mjx.put_model(mujoco.MjModel.from_xml_string(MODEL.format(step=1 / STEPS_PER_SECOND)))


def cost(problem: str, parameters, model):
    """The integral of q^2 by the rectangle rule."""
    from mujoco import mjx

    (q, v), limits, stiffness, damping, gravity, e, force = PROBLEMS[problem](parameters)
    model = model.tree_replace({
        "opt.gravity": jnp.stack([0.0, 0.0, -gravity]), "jnt_range": jnp.asarray(limits)[None],
        "jnt_stiffness": jnp.asarray(stiffness)[None], "dof_damping": jnp.asarray(damping)[None],
        "jnt_solref": spring(e)[None],
    })  # fmt: skip
    start = mjx.make_data(model).replace(qpos=jnp.asarray(q)[None], qvel=jnp.asarray(v)[None])
    step = 1 / STEPS_PER_SECOND

    def body(carry, k):
        data, total = carry
        total = total + step * data.qpos[0] ** 2
        data = mjx.step(model, data.replace(qfrc_applied=jnp.asarray(force(k * step))[None]))
        return (data, total), None

    steps = round(HORIZON[problem] * STEPS_PER_SECOND)
    (_, total), _ = jax.lax.scan(body, (start, jnp.zeros(())), jnp.arange(steps))
    return total


def build(problem: str, tolerance: float):
    """(value(p), value_and_gradient(p)), compiled; the tolerance has no meaning here."""
    reference.require(available())
    del tolerance
    value = partial(cost, problem, model=model_of(problem))
    both = jax.jit(lambda p: (value(p), jax.jacfwd(value)(p)))
    return jax.jit(value), both


def main() -> None:
    """Print errors and times."""
    reference.require(available())
    jax.config.update("jax_enable_x64", True)
    reference.print_header()
    waiting = lambda function, p: jax.block_until_ready(function(p))
    for problem in ("P1", "P2"):
        p = jnp.asarray(references.load(problem).parameters)
        start = time.perf_counter()
        value, both = build(problem, 0.0)
        J, gradient = both(p)
        found = reference.errors(problem, float(J), np.asarray(gradient))
        value(p)
        compile_seconds = time.perf_counter() - start
        forward, seconds = (reference.seconds_per_call(waiting, f, p, repeats=3) for f in (value, both))
        reference.print_row(f"{problem} MJX, forward mode", found, forward, seconds, compile_seconds)


if __name__ == "__main__":
    main()
