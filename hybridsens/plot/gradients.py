"""The picture of gradients: bars of several methods side by side."""

import numpy as np
from jaxtyping import Float
from matplotlib.axes import Axes

from .figure import ABOVE

ROUNDING = 1e-10
"""A derivative that is so much smaller than the largest one is drawn as zero."""


def plot_gradients(axes: Axes, names: list[str], gradients: dict[str, Float[np.ndarray, "parameter"]]) -> None:
    """Derivatives per parameter as one bar for each method; each parameter is scaled by the largest of its bars."""
    fills = (("#14213d", ""), ("white", ""), ("#e6a57e", "////"), ("0.8", "...."))
    scale = np.max(np.abs(np.stack(list(gradients.values()))), axis=0)
    scale[scale <= ROUNDING * np.max(scale, initial=0)] = np.inf  # a zero, by methods that leave rounding
    height = 0.8 / len(gradients)
    for i, (label, values) in enumerate(gradients.items()):
        face, hatch = fills[i % len(fills)]
        places = np.arange(len(names)) + (i - (len(gradients) - 1) / 2) * height
        look = {"facecolor": face, "hatch": hatch, "edgecolor": "#14213d", "linewidth": 0.8}
        axes.barh(places, values / scale, height, label=label, **look)
    axes.set_xlim(-1.1, 1.1)
    axes.set_xticks([-1, 0, 1])
    axes.axvline(0, color="black", linewidth=0.8)
    axes.set_yticks(np.arange(len(names)), [name.replace("_", " ") for name in names])
    axes.set_xlabel("dJ/dtheta, scaled per parameter")
    axes.invert_yaxis()
    axes.legend(ncols=len(gradients), columnspacing=1, handlelength=1.5, **ABOVE)
