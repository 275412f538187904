"""CasADi: an integrator with events whose value and adjoint gradient are generated to C and compiled.

The `erk` plugin with fixed steps (generated code needs a tape of known length) finds where an entry of `zero`
becomes negative and calls `transition`. `build` gives Python functions, which also run the generated
code over many parameters in a C loop, so that the time of a call is that of the code and not of Python.
"""

import ctypes
import importlib.util
import shutil
import subprocess
import tempfile
import time
from pathlib import Path

import numpy as np

from tests.problems import references

from . import reference
from .casadi_problems import PROBLEMS

if importlib.util.find_spec("casadi") is not None:
    import casadi as ca

# Steps for a gradient error like that of the other peers at tolerance 1e-8. P1 and P4 are ballistic: only the
# dense output at an impact leaves an error, and only in the integral of q^2.
STEPS = {"P1": 30, "P2": 200, "P2b": 200, "P4": 10}
MAX_EVENTS = 64

# Runs the generated function over `count` parameter vectors, one work area for all.
LOOP = """
#include <stdlib.h>
int NAME_many(const double* parameters, long long count, int n, double* values, double* gradients) {
  casadi_int sz_arg, sz_res, sz_iw, sz_w;
  NAME_work(&sz_arg, &sz_res, &sz_iw, &sz_w);
  const double** arg = malloc(sz_arg * sizeof(double*));
  double** res = malloc(sz_res * sizeof(double*));
  casadi_int* iw = malloc(sz_iw * sizeof(casadi_int));
  double* w = malloc(sz_w * sizeof(double));
  int flag = 0;
  int mem = NAME_checkout();
  for (long long i = 0; i < count && !flag; ++i) {
    arg[0] = parameters + i * n;
    res[0] = values + i;
    if (gradients) res[1] = gradients + i * n;
    flag = NAME(arg, res, iw, w, mem);
  }
  NAME_release(mem);
  free(arg); free(res); free(iw); free(w);
  return flag;
}
"""


def available() -> str | None:
    """Why this peer cannot run here, or `None` if it can."""
    if importlib.util.find_spec("casadi") is None:
        return "casadi is not installed (pip install casadi)"
    return None if shutil.which("gcc") else "gcc is not installed"


def functions(problem: str, steps: int, mode: str = "adjoint"):
    """CasADi functions parameters -> value and parameters -> (value, gradient), interpreted.

    `mode` is "adjoint" or "forward", one sensitivity direction per parameter.
    """
    count = len(references.load(problem).parameters)
    t, p, index, none = ca.SX.sym("t"), ca.SX.sym("p", count), ca.SX.sym("index"), ca.SX.sym("none", 0)
    x, rate, running_cost, gaps, after, start, horizon = PROBLEMS[problem](t, p)
    x, outcomes = ca.vertcat(*x), [ca.vertcat(*state) for state in after]
    state_after = outcomes[0] if len(outcomes) == 1 else ca.if_else(index == 0, *outcomes)
    transition = ca.Function("reset", [index, t, x, none, p, none], [state_after, none], ca.event_in(), ca.event_out())
    dae = {"t": t, "x": x, "p": p, "ode": ca.vertcat(*rate), "zero": ca.vertcat(*gaps)}
    if running_cost is not None:
        dae["quad"] = running_cost
    options = {"transition": transition, "step_size": horizon / steps, "max_events": MAX_EVENTS}
    motion = ca.integrator("motion", "erk", dae, 0, horizon, options)
    parameters = ca.MX.sym("parameters", count)
    initial = ca.vertcat(*[parameters[k] if k < 2 and problem == "P1" else start[k] for k in range(x.numel())])
    end = motion(x0=initial, p=parameters)
    value = end["xf"][1] if running_cost is None else end["qf"]
    if mode == "adjoint":
        gradient = ca.gradient(value, parameters)
    else:
        gradient = ca.jtimes(value, parameters, ca.DM.eye(count))
    return ca.Function("value", [parameters], [value]), ca.Function("both", [parameters], [value, gradient])


class Compiled:
    """A CasADi function of one vector, with one or two outputs, as machine code."""

    def __init__(self, function):
        name = function.name()
        self.parameter_count, self.has_gradient = function.size1_in(0), function.n_out() > 1
        with tempfile.TemporaryDirectory() as folder:
            source, library = Path(folder, name + ".c"), Path(folder, name + ".so")
            generator = ca.CodeGenerator(source.name)
            generator.add(function)
            generator.generate(folder + "/")
            source.write_text(source.read_text() + LOOP.replace("NAME", name))
            flags = ["-O3", "-march=native", "-fPIC", "-shared"]
            subprocess.run(["gcc", *flags, source, "-o", library, "-lm"], check=True)
            self.function = ca.external(name, str(library))  # the way a CasADi user calls it
            self._many = ctypes.CDLL(str(library))[name + "_many"]

    def many(self, parameters_array):
        """Values (sample,) and gradients (sample, parameter), or `None` for them, in one call of the C loop."""
        parameters = np.ascontiguousarray(parameters_array, float)
        count, n = parameters.shape
        values, gradients = np.empty(count), np.empty((count, n)) if self.has_gradient else None
        pointers = [None if a is None else a.ctypes.data_as(ctypes.c_void_p) for a in (parameters, values, gradients)]
        if self._many(pointers[0], ctypes.c_longlong(count), ctypes.c_int(n), *pointers[1:]):
            raise RuntimeError("CasADi's generated code reports failure")
        return values, gradients


def build(problem: str, steps: int | None = None, mode: str = "adjoint"):
    """Compiled functions of the parameters: `value(p)`, and `value_and_gradient(p)`, a value and an array.

    Both carry `.many(parameters_array)`; see `Compiled.many`.
    """
    reference.require(available())
    value, both = (Compiled(function) for function in functions(problem, steps or STEPS[problem], mode))

    def value_function(parameters):
        return float(value.function(parameters))

    def gradient_function(parameters):
        cost, gradient = both.function(parameters)
        return float(cost), np.asarray(gradient).ravel()

    value_function.many, gradient_function.many = value.many, both.many
    return value_function, gradient_function


def main(batch_size: int = 200) -> None:
    """Print errors and times inside the C loop, from Python, and of CasADi's virtual machine."""
    reference.require(available())
    reference.print_header()
    for problem, steps in STEPS.items():
        parameters = references.load(problem).parameters
        start = time.perf_counter()
        value, gradient = build(problem)
        compile_seconds = time.perf_counter() - start
        found = reference.errors(problem, *gradient(parameters))
        same = np.tile(parameters, (batch_size, 1))
        times = [reference.seconds_per_call(f.many, same) / batch_size for f in (value, gradient)]
        reference.print_row(f"{problem} CasADi C, {steps} steps", found, *times, compile_seconds)
        times = [reference.seconds_per_call(f, parameters) for f in (value, gradient)]
        reference.print_row("    called from Python", found, *times, None)
        interpreted = functions(problem, steps)
        times = [reference.seconds_per_call(f, parameters) for f in interpreted]
        reference.print_row("    interpreted", found, *times, None)


if __name__ == "__main__":
    main()
