"""The same motions in micrometres and microseconds and in kilometres and hours: the same numbers without dimension.

    python -m benchmarks.extremes.units

`atol` is a length and a speed at once, so it is scaled with the smaller of both units' factors. Left at its default, in
units in which the motion is no longer than a hundred times `atol`, the error control has nothing to hold on to.
"""

import argparse

import jax.numpy as jnp

from tests.problems import one_contact as one

from .report import Row, main_of, status_name

UNITS = {
    "metre, second": (1.0, 1.0),
    "micrometre, microsecond": (1e-6, 1e-6),
    "kilometre, hour": (1e3, 3600.0),
    "nanometre, year": (1e-9, 3.2e7),
    "megametre, second": (1e6, 1.0),
}
MOTIONS = {
    "ball that bounces to rest": (dict(load=-9.81, offset=-0.5, e=0.8), 1.5, 0.0, 5.0),
    "oscillator and stop": (dict(stiffness=1.0, side=-1.0, offset=1.0, e=0.7), 0.0, 1.5, 12.0),
    "ball pressed by a spring": (dict(load=-1.0, stiffness=3.0, offset=0.1, e=0.4), 0.4, 0.0, 8.0),
}


def study() -> list[Row]:
    """Relative change of int q^2 / (length^2 time), with `atol` scaled and with the default of 1e-8."""
    rows = []
    for motion, (scene, q, v, t1) in MOTIONS.items():
        _, _, metres = one.go(one.make(**scene), q, v, t1, atol=jnp.array(1e-10))
        for units, (length, time) in UNITS.items():
            scaled = scene | {
                "load": scene.get("load", 0.0) * time**2 / length,
                "stiffness": scene.get("stiffness", 0.0) * time**2,
                "offset": scene.get("offset", 0.0) / length,
            }
            start = q / length, v * time / length, t1 / time
            for how, atol in (("", 1e-10 * min(1 / length, time / length, 1.0)), (", atol = 1e-8", 1e-8)):
                _, _, found = one.go(one.make(**scaled), *start, atol=jnp.array(atol))
                error = one.relative(found.cost * length**2 * time, metres.cost)
                rows.append(Row("units", f"{motion}{how}", units, error, status_name(found)))
    return rows


if __name__ == "__main__":
    main_of("units", lambda _: study(), argparse.ArgumentParser(description=__doc__))
