"""A learned estimate of edge costs: regression of log(J / straight-line estimate).

It ranks edges well and scatters by a few percent; its spread on held-out edges is what a
*conditional* gap may lean on. It is never a bound.

The estimate decides which edges are solved, so it must be the same on every machine: sums are made
in one order by our own kernels (`sequencing.edges.regression`), never by the BLAS of the day, and
what libraries compute is rounded before it decides.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from dmoc.arrays import Array
from sequencing.edges.regression import GaussianProcess, fit_process

# Digits that the last bits of a library's logarithm cannot reach.
DIGITS = 9


def edge_features(
    waypoints: Array, gravity: Array, pairs: npt.NDArray[np.int64], rough: Array, hits: Array
) -> Array:
    """Features (K, F), equal for both directions of an edge.

    `waypoints` (K, 4, n): poses and ends of departure lines; `gravity` (V, n) holding torques of
    the nodes [N·m]; `rough` (K, 4): straight-line cost, duration, gravity and inertia parts;
    `hits` (K,): share of the straight line that collides.
    """
    delta = np.abs(waypoints[:, 3] - waypoints[:, 0])
    inner = np.abs(waypoints[:, 2] - waypoints[:, 1])
    mean = 0.5 * (waypoints[:, 3] + waypoints[:, 0])
    a, b = gravity[pairs[:, 0]], gravity[pairs[:, 1]]
    ends = np.stack([np.sum(a * a, axis=1), np.sum(b * b, axis=1)], axis=1)
    lines = np.linalg.norm(waypoints[:, 1] - waypoints[:, 0], axis=1) + np.linalg.norm(
        waypoints[:, 3] - waypoints[:, 2], axis=1
    )
    columns = np.column_stack(
        [
            np.log(np.maximum(rough, 1e-9)),
            hits,
            delta,
            inner,
            mean,
            np.linalg.norm(delta, axis=1),
            lines,
            ends.min(axis=1),
            ends.max(axis=1),
            np.sum(a * b, axis=1),
        ]
    )
    return np.round(columns, DIGITS)


@dataclass(frozen=True)
class LearnedEstimate:
    """A fitted model and its scores on held-out edges (`held_out`, sorted).

    The score of an edge is log(true / predicted) divided by the deviation that the model itself
    states there: far from what it was fitted to it may err more, and says so.
    """

    model: GaussianProcess
    held_out: Array

    def predict(self, features: Array, rough_cost: Array) -> Array:
        """Estimated J (K,) of edges with the straight-line cost `rough_cost` (K,)."""
        mean = self.model.predict(features)[0]
        return np.round(rough_cost * np.exp(mean), DIGITS)

    def factors(self, features: Array, quantile: float) -> tuple[Array, float]:
        """(factors (K,), coverage): an edge costs at least its factor × its estimate.

        factor = exp(z σ), at most 1, with σ the model's deviation at the edge and z the k-th lowest
        of the m held-out scores, k = max(1, ⌊quantile (m + 1)⌋). The score of another edge drawn
        at random exceeds z with probability 1 − k/(m + 1), whatever the distribution and however
        poor σ is: only how tight the factors are depends on σ (split conformal prediction with
        normalised scores, Papadopoulos et al. 2002). Without held-out edges: (0, 1), which assumes
        nothing.
        """
        count = len(self.held_out)
        if count == 0 or len(features) == 0:
            return np.zeros(len(features)), 1.0
        place = max(1, int(np.floor(quantile * (count + 1) + 1e-9)))
        spread = self.model.predict(features)[1]
        factors = np.round(np.minimum(1.0, np.exp(self.held_out[place - 1] * spread)), DIGITS)
        return factors, 1.0 - place / (count + 1)


def training_pairs(
    pairs: npt.NDArray[np.int64], rough_cost: Array, draw: Array, training: int, held_out: int
) -> tuple[npt.NDArray[np.int64], npt.NDArray[np.int64]]:
    """Edges to solve before anything is decided: (training, held out), each (K, 2), disjoint.

    `draw` (P,) are random numbers, one an edge, that depend on nothing but the edge and the seed:
    so a changed stud leaves the choice among the other edges nearly as it was. Half of the
    training edges are drawn from all, half from the cheapest tenth (tours use those); the held-out
    edges are drawn from all that are left. Small stations keep a quarter of the edges held out.
    """
    training = min(training, max(2, len(pairs) * 3 // 4))
    order = np.argsort(np.round(rough_cost, DIGITS), kind="stable")
    near = order[: max(training, len(pairs) // 10)]
    chosen = near[np.argsort(draw[near], kind="stable")][: training // 2]
    lots = np.argsort(draw, kind="stable")
    rest = lots[~np.isin(lots, chosen)]
    more = rest[: training - len(chosen)]
    held = rest[len(more) : len(more) + held_out]
    return pairs[np.sort(np.concatenate([chosen, more]))], pairs[np.sort(held)]


def fit_estimate(
    features: Array, rough_cost: Array, cost: Array, held: tuple[Array, Array, Array]
) -> LearnedEstimate:
    """Fit log(J / straight-line) on solved edges; `held` are features, rough and true costs.

    Edges without a motion (inf) teach nothing about cost and are left out.
    """
    good = np.isfinite(cost)
    targets: Array = np.log(cost[good] / rough_cost[good])
    model = fit_process(features[good], np.round(targets, DIGITS))
    held_features, held_rough, held_cost = held
    usable = np.isfinite(held_cost)
    mean, spread = model.predict(held_features[usable])
    score = (np.log(held_cost[usable] / held_rough[usable]) - mean) / spread
    return LearnedEstimate(model, np.sort(np.round(score, DIGITS)))
