"""Filling holes in a grid."""

import numpy as np
from scipy.sparse import csr_matrix
from scipy.sparse.linalg import splu

from gonio.geometry import Array


def fill_holes(grid: Array) -> Array:
    """`grid` (V, U, C) with its NaN replaced by the solution of Laplace's equation; all channels have the same holes.

    Rows are periodic (the last is the first again), no flow over the first and last column. A grid of holes alone
    comes back as it is.
    """
    rows, columns = grid.shape[0] - 1, grid.shape[1]
    inner = grid[:-1].reshape(rows * columns, -1).copy()
    hole = np.asarray(np.isnan(inner).any(1))
    if hole.all() or not hole.any():
        return grid
    number = np.full(rows * columns, -1)
    number[hole] = np.arange(hole.sum())
    at = np.flatnonzero(hole)
    row, column = at // columns, at % columns
    equation, unknown, entry = [], [], []
    degree, right = np.zeros(len(at)), np.zeros((len(at), inner.shape[1]))
    for down, along in ((-1, 0), (1, 0), (0, -1), (0, 1)):
        inside = (column + along >= 0) & (column + along < columns)
        neighbour = (row + down) % rows * columns + np.clip(column + along, 0, columns - 1)
        degree += inside
        open_ = inside & hole[neighbour]
        equation.append(np.flatnonzero(open_))
        unknown.append(number[neighbour[open_]])
        entry.append(np.full(open_.sum(), -1.0))
        known = inside & ~hole[neighbour]
        right[known] += inner[neighbour[known]]
    n = np.arange(len(at))
    index = (np.concatenate([*equation, n]), np.concatenate([*unknown, n]))
    matrix = csr_matrix((np.concatenate([*entry, degree]), index), shape=(len(at), len(at)))
    inner[hole] = splu(matrix.tocsc()).solve(right)
    filled = inner.reshape(rows, columns, -1)
    return np.concatenate([filled, filled[:1]])
