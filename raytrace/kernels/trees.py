"""Trees of boxes: what a ray may meet of many pieces, the nearest first."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from raytrace.kernels.compiled import compiled, inner

Array = NDArray[np.float64]
Index = NDArray[np.int64]

LEAF = 2  # boxes of a leaf
NODES = 128  # that wait while a ray is followed; a tree is less deep than that


class Tree(NamedTuple):
    """Boxes in boxes.

    Attributes
    ----------
    boxes : (k, 6), mm, of each node: lows then highs.
    links : (k, 2), the first of two children, 0; or the first box of a leaf, their count.
    """

    boxes: Array
    links: Index


def tree_of(boxes: Array, leaf: int = LEAF) -> tuple[Tree, Index]:
    """Make a tree over boxes.

    Each node is parted at the median of its boxes' middles along the axis in which these reach farthest, so that m boxes
    have a tree log2 m deep.

    Parameters
    ----------
    boxes : (m, 6), mm, lows then highs.
    leaf : boxes of a leaf at most.

    Returns
    -------
    tree
    order : (m,), in which its leaves take the boxes.
    """
    order = np.arange(len(boxes))
    links, nodes = np.empty((2 * len(boxes), 2), dtype=np.int64), np.empty((2 * len(boxes), 6))
    count = _plant(boxes, 0.5 * (boxes[:, :3] + boxes[:, 3:]), leaf, order, nodes, links)
    return Tree(nodes[:count].copy(), links[:count].copy()), order


@compiled(nogil=True)
def _plant(boxes, middles, leaf, order, nodes, links):
    """Fill the tree's nodes and links; returns how many there are."""
    waiting = np.empty((128, 3), dtype=np.int64)  # nodes to be filled: number, first box, end
    waiting[0] = np.array([0, 0, len(order)])
    left, count = 1, 1
    while left > 0:
        left -= 1
        node, first, end = waiting[left]
        low, high = np.full(3, np.inf), np.full(3, -np.inf)
        nodes[node, :3], nodes[node, 3:] = np.inf, -np.inf
        for k in range(first, end):
            for c in range(3):
                nodes[node, c] = min(nodes[node, c], boxes[order[k], c])
                nodes[node, c + 3] = max(nodes[node, c + 3], boxes[order[k], c + 3])
                low[c], high[c] = min(low[c], middles[order[k], c]), max(high[c], middles[order[k], c])
        if end - first <= leaf:
            links[node] = np.array([first, end - first])
            continue
        axis = int(np.argmax(high - low))
        part = order[first:end]
        order[first:end] = part[np.argsort(middles[part, axis], kind="mergesort")]
        middle = (first + end) // 2
        links[node] = np.array([count, 0])
        waiting[left] = np.array([count, first, middle])
        waiting[left + 1] = np.array([count + 1, middle, end])
        left += 2
        count += 2
    return count


@inner()
def inverse(component):
    """1/d; a direction of no share along an axis gets one that is none, so that no zero is multiplied with infinity."""
    return 1.0 / (component if abs(component) > 1e-200 else 1e-200)


@inner()
def entered(boxes, k, ox, oy, oz, ix, iy, iz, farthest):
    """Distance at which a ray enters a box, by the inverse of its direction; inf where it does not before `farthest`."""
    a, b = (boxes[k, 0] - ox) * ix, (boxes[k, 3] - ox) * ix
    near, far = min(a, b), max(a, b)
    a, b = (boxes[k, 1] - oy) * iy, (boxes[k, 4] - oy) * iy
    near, far = max(near, min(a, b)), min(far, max(a, b))
    a, b = (boxes[k, 2] - oz) * iz, (boxes[k, 5] - oz) * iz
    near, far = max(near, min(a, b)), min(far, max(a, b))
    return near if near <= far and far > 0.0 and near < farthest else np.inf


@inner()
def put_children(nodes, child, ox, oy, oz, ix, iy, iz, farthest, stack, entries, left):
    """Put those of two children on the stack that a ray enters, the nearer one last, since it is taken first; how many wait."""
    one = entered(nodes, child, ox, oy, oz, ix, iy, iz, farthest)
    other = entered(nodes, child + 1, ox, oy, oz, ix, iy, iz, farthest)
    nearer = 0 if one <= other else 1
    for turn in range(2):
        which = 1 - nearer if turn == 0 else nearer
        entry = other if which == 1 else one
        if entry < np.inf:
            stack[left], entries[left] = child + which, entry
            left += 1
    return left
