"""Gaussian-process regression with every sum in one order: the same bits on every machine.

A rough and a smooth part (obstacles bend the cost on the scale of single edges, the arm's dynamics
on the scale of the workspace):

    k(x, y) = a Matérn₅⸝₂(|x − y| / l) + b exp(−|x − y|² / 2 m²) + noise · [x is y]

Features and targets are standardised. The five numbers maximise the likelihood by a search on a
grid of their logarithms, which rounding cannot move. Loops run over many points at once and keep
each point's own sum in order, so they are fast without a reordering.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from dmoc.arrays import Array
from dmoc.jit import njit

# log of a, l, b, m, noise: where the search begins, and how far it may go.
BEGIN = np.log([0.05, 6.0, 0.1, 10.0, 1e-4])
LOW = np.log([1e-5, 0.5, 1e-5, 0.5, 1e-6])
HIGH = np.log([1e5, 100.0, 1e5, 1e3, 1e-2])
FIRST_STEP, LAST_STEP = 1.0, 0.125
MOST_SWEEPS = 60
#: A likelihood must grow by this to count; more points than this say nothing new about the five.
WORTH = 1e-6
MOST_POINTS = 256
BLOCK = 512


@njit(inner=True)
def _exp(x):  # type: ignore[no-untyped-def]
    """e^x for x ≤ 0 to 1e-15, by arithmetic alone: libraries differ in the last bit."""
    if x < -700.0:
        return 0.0
    k = math.floor(x * 1.4426950408889634 + 0.5)
    r = (x - k * 0.6931471803691238) - k * 1.9082149292705877e-10
    total = 1.0
    for i in range(14, 0, -1):
        total = 1.0 + total * r / i
    return math.ldexp(total, int(k))


@njit
def _squares(a, b, out):  # type: ignore[no-untyped-def]
    """|a_i − b_j|² of rows a (n, F) and columns b (F, m) into out (n, m)."""
    for i in range(a.shape[0]):
        for j in range(b.shape[1]):
            out[i, j] = 0.0
        for f in range(a.shape[1]):
            x = a[i, f]
            for j in range(b.shape[1]):
                d = x - b[f, j]
                out[i, j] += d * d


@njit
def _covary(squares, values, out):  # type: ignore[no-untyped-def]
    """k of squared distances, without the noise; `values` are a, l, b, m, noise."""
    a, length, b, wide = values[0], values[1], values[2], values[3]
    for i in range(squares.shape[0]):
        for j in range(squares.shape[1]):
            s = squares[i, j]
            x = math.sqrt(5.0 * s) / length
            rough = a * (1.0 + x + x * x / 3.0) * _exp(-x)
            out[i, j] = rough + b * _exp(-0.5 * s / (wide * wide))


@njit
def _factor(matrix):  # type: ignore[no-untyped-def]
    """The lower triangle L of matrix = L Lᵀ in its place; False if there is none."""
    n = matrix.shape[0]
    column = np.empty(n)
    for j in range(n):
        if not matrix[j, j] > 0.0:
            return False
        pivot = math.sqrt(matrix[j, j])
        matrix[j, j] = pivot
        for i in range(j + 1, n):
            matrix[i, j] /= pivot
            column[i] = matrix[i, j]
        for i in range(j + 1, n):
            x = column[i]
            for c in range(j + 1, i + 1):
                matrix[i, c] -= x * column[c]
    return True


@njit
def _forward(lower, rows):  # type: ignore[no-untyped-def]
    """L⁻¹ rows in the place of rows (n, m)."""
    for i in range(lower.shape[0]):
        for j in range(i):
            x = lower[i, j]
            for c in range(rows.shape[1]):
                rows[i, c] -= x * rows[j, c]
        for c in range(rows.shape[1]):
            rows[i, c] /= lower[i, i]


@njit
def _backward(lower, values):  # type: ignore[no-untyped-def]
    """L⁻ᵀ values in the place of values (n,)."""
    n = lower.shape[0]
    for i in range(n - 1, -1, -1):
        values[i] /= lower[i, i]
        for j in range(i):
            values[j] -= lower[i, j] * values[i]


@njit
def _fold(weights, rows, squared, out):  # type: ignore[no-untyped-def]
    """Σ_i w_i r_ij, or Σ_i r_ij² if `squared`, into out (m,)."""
    for j in range(rows.shape[1]):
        out[j] = 0.0
    for i in range(rows.shape[0]):
        x = weights[i]
        for j in range(rows.shape[1]):
            out[j] += rows[i, j] * (rows[i, j] if squared else x)


@dataclass(frozen=True)
class GaussianProcess:
    """A fitted process: `centre`, `scale` of the features (F,), `mean`, `spread` of the targets,
    points (n, F), `values` a, l, b, m, noise, the factor (n, n) of their covariance and weights.
    """

    centre: Array
    scale: Array
    mean: float
    spread: float
    points: Array
    values: Array
    lower: Array
    weights: Array

    def predict(self, features: Array) -> tuple[Array, Array]:
        """Mean and standard deviation (K,), noise included, at rows of features (K, F)."""
        count, n = len(features), len(self.points)
        mean, left = np.empty(count), np.empty(count)
        for first in range(0, count, BLOCK):
            part = slice(first, min(first + BLOCK, count))
            rows = np.ascontiguousarray(((features[part] - self.centre) / self.scale).T)
            room = np.empty((n, rows.shape[1]))
            _squares(self.points, rows, room)
            _covary(room, self.values, room)
            _fold(self.weights, room, False, mean[part])
            _forward(self.lower, room)
            _fold(self.weights, room, True, left[part])
        variance = self.values[0] + self.values[2] + self.values[4] - left
        deviation = np.sqrt(np.maximum(variance, self.values[4]))
        return self.mean + self.spread * mean, self.spread * deviation


def fit_process(features: Array, targets: Array) -> GaussianProcess:
    """The process of targets (n,) at features (n, F)."""
    count = len(targets)
    centre, scale = _moments(features)
    mean, spread = (float(x[0]) for x in _moments(targets[:, None]))
    points = np.ascontiguousarray((features - centre) / scale)
    known = (targets - mean) / spread
    squares = np.empty((count, count))
    _squares(points, np.ascontiguousarray(points.T), squares)
    few = np.unique(np.linspace(0, count - 1, min(count, MOST_POINTS)).astype(np.int64))
    logs = _search(np.ascontiguousarray(squares[np.ix_(few, few)]), known[few])
    values = _values(logs)
    lower, weights, _ = _solved(squares, known, values)
    _backward(lower, weights)
    return GaussianProcess(centre, scale, mean, spread, points, values, lower, weights)


def _moments(rows: Array) -> tuple[Array, Array]:
    """Mean and standard deviation (F,) of rows (n, F); the deviation of equal numbers is 1."""
    ones = np.full(max(len(rows), 1), 1.0 / max(len(rows), 1))
    centre, square = np.zeros(rows.shape[1]), np.zeros(rows.shape[1])
    _fold(ones, np.ascontiguousarray(rows), False, centre)
    _fold(ones, np.ascontiguousarray(rows - centre), True, square)
    scale = np.sqrt(square * ones[0])
    return centre, np.where(scale > 1e-12, scale, 1.0)


def _values(logs: Array) -> Array:
    return np.array([math.exp(x) for x in logs]).round(12)


def _solved(squares: Array, known: Array, values: Array) -> tuple[Array, Array, float]:
    """Factor L of the covariance, L⁻¹ y, and the logarithm of the likelihood (−inf: no factor)."""
    lower = np.empty_like(squares)
    _covary(squares, values, lower)
    lower[np.diag_indices(len(lower))] += values[4]
    if not _factor(lower):
        return lower, known, -np.inf
    rows = known[:, None].copy()
    _forward(lower, rows)
    square = np.zeros(1)
    _fold(known, rows, True, square)
    logs = sum(math.log(pivot) for pivot in np.diagonal(lower))
    return lower, rows[:, 0].copy(), -0.5 * float(square[0]) - logs


def _search(squares: Array, known: Array) -> Array:
    """The logarithms that are likeliest, one after the other by steps that halve."""
    best = BEGIN.copy()
    highest = _solved(squares, known, _values(best))[2]
    step = FIRST_STEP
    for _ in range(MOST_SWEEPS):
        before = highest
        for k in range(len(best)):
            for sign in (1.0, -1.0):
                other = best.copy()
                other[k] = min(max(best[k] + sign * step, LOW[k]), HIGH[k])
                found = _solved(squares, known, _values(other))[2]
                if found > highest + WORTH:
                    best, highest = other, found
                    break
        if highest == before:
            step /= 2.0
            if step < LAST_STEP:
                break
    return best
