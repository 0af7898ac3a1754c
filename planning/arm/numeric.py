"""Numerical inverse kinematics: batched damped least squares, for polishing and for other arms."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from dmoc.arrays import Array
from planning.arm.screws import ScrewAxes, pose_error

#: Errors below this get no further step [m, rad].
_ENOUGH = 1e-12


def converge(
    chain: ScrewAxes, poses: Array, start_rad: Array, iterations: int = 60
) -> tuple[Array, npt.NDArray[np.bool_]]:
    """Newton-like steps from (K, n) starts to (K, 4, 4) poses; angles, and where they arrived.

    Steps Δq = Jᵀ(JJᵀ + λI)⁻¹e with λ shrinking with the error, at most 0.5 rad; joint limits are
    not enforced. Arrived: position [m] and rotation [rad] error both at most 1e-9.
    """
    q = np.array(start_rad, dtype=float)
    active = np.arange(len(q))
    best = np.full(len(q), np.inf)
    kept = q.copy()
    for _ in range(iterations):
        pose, jacobian = chain.forward_jacobian(q[active])
        error = pose_error(poses[active], pose)
        size = np.max(np.abs(error), axis=1)
        better = size < best[active]
        kept[active[better]] = q[active[better]]
        best[active] = np.minimum(best[active], size)
        going = size > _ENOUGH
        active, error, jacobian = active[going], error[going], jacobian[going]
        if not len(active):
            break
        damping = 1e-3 * np.minimum(np.sum(error * error, axis=1), 1.0)
        gram = jacobian @ np.swapaxes(jacobian, 1, 2)
        gram += (damping + 1e-14)[:, None, None] * np.eye(6)
        step = np.einsum("kij,ki->kj", jacobian, np.linalg.solve(gram, error[..., None])[..., 0])
        longest = np.max(np.abs(step), axis=1, keepdims=True)
        q[active] += step * np.minimum(1.0, 0.5 / np.maximum(longest, 1e-300))
    return kept, best <= 1e-9


def multi_start(chain: ScrewAxes, pose: Array, starts: int, seed: int) -> Array:
    """Solutions (S, n) of one pose (4, 4) within limits from seeded random starts, distinct ones.

    For six joints this finds every branch with high probability (more starts, surer); with more
    joints it samples the self-motion manifold.
    """
    rng = np.random.default_rng(seed)
    lower = np.maximum(chain.lower_rad, -np.pi)
    upper = np.minimum(chain.upper_rad, np.pi)
    lower, upper = np.minimum(lower, upper), np.maximum(lower, upper)
    begin = rng.uniform(lower, upper, size=(starts, chain.num_joints))
    q, arrived = converge(chain, np.broadcast_to(pose, (starts, 4, 4)), begin)
    q = q[arrived]
    middle = 0.5 * (chain.lower_rad + chain.upper_rad)
    q = middle + (q - middle + np.pi) % (2 * np.pi) - np.pi
    kept: list[Array] = []
    for row in q:
        # Two starts that end in one branch differ by less than a tenth of a degree.
        if all(
            np.max(np.abs((row - other + np.pi) % (2 * np.pi) - np.pi)) > 2e-3 for other in kept
        ):
            kept.append(row)
    return np.array(kept).reshape(-1, chain.num_joints)
