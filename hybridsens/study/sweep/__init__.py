"""Values and sensitivities at thousands to millions of points."""

from .dataset import gradients as gradients
from .dataset import status_counts as status_counts
from .designs import Design as Design
from .designs import batch as batch
from .designs import grid as grid
from .designs import latin_hypercube as latin_hypercube
from .designs import random as random
from .designs import saltelli as saltelli
from .designs import sobol as sobol
from .run import sweep as sweep
