"""Connected components of a graph."""

from __future__ import annotations

import numpy as np

from .arrays import IntArray

__all__ = ["components"]


def components(n: int, first: IntArray, second: IntArray) -> IntArray:
    """Number of the component of every node, in order of first appearance, shape (n,).

    As `scipy.sparse.csgraph.connected_components`, whose import takes longer than to read and check a model.

    Parameters
    ----------
    n : int
        Nodes.
    first, second : (m,) int arrays
        Nodes that are joined.

    Examples
    --------
    >>> components(5, np.array([3, 1]), np.array([0, 4])).tolist()
    [0, 1, 2, 0, 1]
    """
    # Every root hangs itself on the smallest that it is joined to, then all look up to the top: at least every other
    # root that is joined to any goes in a round.
    root = np.arange(n)
    while True:
        a, b = root[first], root[second]
        if np.array_equal(a, b):
            return np.asarray(np.unique(root, return_inverse=True)[1])
        np.minimum.at(root, np.maximum(a, b), np.minimum(a, b))
        while not np.array_equal(top := root[root], root):
            root = top
