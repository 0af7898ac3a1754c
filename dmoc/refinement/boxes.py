r"""The paper's boxes: n ‖q⁺ − q‖_{w,∞} ≤ φ(q) − d_c.

With w_j(q) = max_p ‖∂p/∂q_j‖₁ no point of the robot moves further than Σ_j w_j |Δq_j|, so a knot
that stays in its box keeps the clearance d_c to first order. Between the knots the paper checks
nothing; with sub-points, a knot's box is the smallest of its own and of those of the points in
the two intervals beside it, because such a point moves by a convex combination of its two knots.

Source: Björkenstam et al., section 2.4.
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from dmoc.arrays import Array
from dmoc.motion.clearance import Clearance
from dmoc.refinement.iterate import Points
from dmoc.refinement.params import RefineParams
from dmoc.refinement.points import View

# A point that is nearer than d_c (its seed was) may still use this share of what it has above half
# of d_c; a box of no width would leave the solver nothing to move.
_TIGHT_SHARE = 0.5


def kept_level(required: Array, params: RefineParams) -> Array:
    """What points between the knots, and knots whose seed was too near, must keep (P,) [m]."""
    return np.maximum(np.minimum(params.floor_m, required), 0.5 * required)


def box_half_widths(
    clearance: Clearance,
    view: View,
    points: Points,
    required: Array,
    fixed: npt.NDArray[np.bool_],
    params: RefineParams,
) -> Array:
    """Half-widths (N+1, n) [rad] of the boxes around the knots; 0 at fixed knots."""
    weights = np.maximum(clearance.weights(view.q_rad), 1e-9)
    # n joints share what is spare: each may use an nth of it, so that all at their rim together use
    # it up exactly. That factor is the paper's; without it a knot could reach the obstacle.
    above = view.phi_m - required
    spare = np.where(above >= 0, above, _TIGHT_SHARE * (view.phi_m - kept_level(required, params)))
    width = np.maximum(spare, 0.0)[:, None] / (weights.shape[1] * weights)
    half = np.full((len(fixed), weights.shape[1]), params.trust_most_rad)
    # Unbuffered, because several points belong to one knot: `half[i] = minimum(…)` would keep the
    # last of them only.
    np.minimum.at(half, points.interval, width)
    inner = points.fraction > 0
    np.minimum.at(half, points.interval[inner] + 1, width[inner])
    half[fixed] = 0.0
    return half
