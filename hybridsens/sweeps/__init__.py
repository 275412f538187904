"""Values and sensitivities at thousands to millions of points.

    design = grid(scene, {"amplitude": np.linspace(0.5, 1.5, 100), "frequency": np.linspace(1.0, 2.0, 100)})
    dataset = sweep(cost, design, store="map.zarr")
    plot_sweep(dataset)

`designs.py` chooses the points, `point.py` runs one of them, `engine.py` many, `run.py` all, chunk by chunk.
"""

from .dataset import gradients as gradients
from .dataset import status_counts as status_counts
from .designs import Design as Design
from .designs import batch as batch
from .designs import grid as grid
from .designs import latin_hypercube as latin_hypercube
from .designs import random as random
from .designs import saltelli as saltelli
from .designs import sobol as sobol
from .plot import plot_bifurcation as plot_bifurcation
from .plot import plot_sweep as plot_sweep
from .run import sweep as sweep
from .sensitivity import dgsm as dgsm
from .sensitivity import sobol_indices as sobol_indices
