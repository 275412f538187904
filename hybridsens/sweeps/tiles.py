"""How the points are cut into chunks: rectangular tiles, each computed, stored and resumed as a whole."""

import itertools
import math


def tile_shape(shape: dict[str, int], points: int) -> dict[str, int]:
    """Edge lengths of tiles with at most `points` points each.

    The last dimensions stay whole as long as they fit, one dimension is cut in pieces of nearly equal length (so that
    little of the last one is padding), and those before it are taken one index at a time.
    """
    edges, room = {}, points
    for name, size in reversed(shape.items()):
        edge = min(size, max(room, 1))
        edges[name] = math.ceil(size / math.ceil(size / edge))
        room //= size
    return {name: edges[name] for name in shape}


def tiles(shape: dict[str, int], edges: dict[str, int]) -> list[dict[str, slice]]:
    """All tiles, in the order of the points: slices by the name of the dimension."""
    cuts = [
        [(name, slice(start, min(start + edges[name], size))) for start in range(0, size, edges[name])]
        for name, size in shape.items()
    ]
    return [dict(tile) for tile in itertools.product(*cuts)]


def points_in(tile: dict[str, slice]) -> int:
    """Number of points in a tile."""
    return math.prod(cut.stop - cut.start for cut in tile.values())
