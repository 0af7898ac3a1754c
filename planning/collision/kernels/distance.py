"""Distance of two convex pieces, with a proof.

Gilbert, Johnson, Keerthi (1988) on the difference A − B. Any direction v gives a separating
plane, so  min_{w ∈ A−B} v·w / ‖v‖  is a lower bound of the distance whatever the iteration did,
and the norm of any point of A − B an upper one. The iteration ends when the two agree; where it
does not end so, the caller sees the gap and asks an engine.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from dmoc.jit import njit
from planning.collision.kernels.simplex import INSIDE, nearest

FAR = 0
"""Proven farther than the threshold `above`; the distance is a lower bound only."""
SOLVED = 1
"""Lower and upper bound agree."""
HIT = 2
"""Proven nearer than `below` (cores may overlap); the distance is an upper bound only."""
OPEN = 3
"""The bounds did not meet: ask an engine."""

MAX_ITERATIONS = 60
GAP_M = 1e-10
SCAN = 12


@njit(plain=True, inner=True)
def support(
    solids: Any, p: int, dx: float, dy: float, dz: float, hint: int
) -> tuple[float, float, float, int]:
    """The point of core p farthest along d, both in the piece's frame; vertex found last."""
    info, size, verts = solids.info, solids.size, solids.verts
    near_start, near = solids.near_start, solids.near
    kind = info[p, 1]
    if kind == 1:
        return (
            size[p, 0] if dx >= 0 else -size[p, 0],
            size[p, 1] if dy >= 0 else -size[p, 1],
            size[p, 2] if dz >= 0 else -size[p, 2],
            0,
        )
    if kind == 3:
        return 0.0, 0.0, 0.0, 0
    if kind == 2:
        across = np.sqrt(dx * dx + dy * dy)
        z = size[p, 4] if dz >= 0 else -size[p, 4]
        if across <= 0.0:
            return 0.0, 0.0, z, 0
        scale = size[p, 3] / across
        return dx * scale, dy * scale, z, 0
    first, count = info[p, 2], info[p, 3]
    if count <= SCAN:
        best, at = -1e300, first
        for v in range(first, first + count):
            value = verts[v, 0] * dx + verts[v, 1] * dy + verts[v, 2] * dz
            if value > best:
                best, at = value, v
        return verts[at, 0], verts[at, 1], verts[at, 2], at
    # Climb along the hull's edges: on a convex polytope a vertex without a better neighbour is
    # the best one.
    at = hint if first <= hint < first + count else first
    best = verts[at, 0] * dx + verts[at, 1] * dy + verts[at, 2] * dz
    climbing = True
    while climbing:
        climbing = False
        here = at
        for k in range(near_start[here], near_start[here + 1]):
            v = near[k]
            value = verts[v, 0] * dx + verts[v, 1] * dy + verts[v, 2] * dz
            if value > best:
                best, at = value, v
                climbing = True
    return verts[at, 0], verts[at, 1], verts[at, 2], at


@njit(plain=True)
def outer_bound(pose: Any, size: Any, a: int, b: int) -> float:
    """A lower bound of the distance of separated pieces, from balls and boxes around them [m].

    For pieces that overlap it is not positive, and no bound of the depth.
    """
    dx = pose[b, 12] - pose[a, 12]
    dy = pose[b, 13] - pose[a, 13]
    dz = pose[b, 14] - pose[a, 14]
    bound = np.sqrt(dx * dx + dy * dy + dz * dz) - size[a, 12] - size[b, 12]
    other = _ball_box(pose, size, a, dx, dy, dz) - size[b, 12]
    if other > bound:
        bound = other
    other = _ball_box(pose, size, b, -dx, -dy, -dz) - size[a, 12]
    return other if other > bound else bound


@njit(plain=True)
def clearly_farther(pose: Any, size: Any, a: int, b: int, limit: float) -> bool:
    """Whether balls or boxes around the pieces are farther apart than `limit`.

    Always false for a negative limit: balls and boxes bound no depth.
    """
    if limit < 0.0:
        return False
    dx = pose[b, 12] - pose[a, 12]
    dy = pose[b, 13] - pose[a, 13]
    dz = pose[b, 14] - pose[a, 14]
    reach = size[a, 12] + size[b, 12] + limit
    if dx * dx + dy * dy + dz * dz > reach * reach:
        return True
    reach = size[b, 12] + limit
    if _ball_box_squared(pose, size, a, dx, dy, dz) > reach * reach:
        return True
    reach = size[a, 12] + limit
    return _ball_box_squared(pose, size, b, dx, dy, dz) > reach * reach


@njit(plain=True, inner=True)
def _ball_box_squared(pose: Any, size: Any, p: int, dx: float, dy: float, dz: float) -> float:
    """Squared distance of the point centre + d to the box around piece p."""
    total = 0.0
    for k in range(3):
        x = abs(pose[p, k] * dx + pose[p, 3 + k] * dy + pose[p, 6 + k] * dz) - size[p, 9 + k]
        if x > 0.0:
            total += x * x
    return total


@njit(plain=True, inner=True)
def _ball_box(pose: Any, size: Any, p: int, dx: float, dy: float, dz: float) -> float:
    """Distance of the point centre + d to the box around piece p."""
    return np.sqrt(_ball_box_squared(pose, size, p, dx, dy, dz))


@njit(plain=True)
def gjk(
    solids: Any,
    pose: Any,
    a: int,
    b: int,
    axis: Any,
    above: float,
    below: float,
    s: Any,
    out: Any,
) -> int:
    """Distance of pieces a and b [m], decided no further than `above` and `below`.

    `axis` (3,) is the direction to start with (from b to a; zero: from the centres) and the last
    one on return; `s` (4, 15) is workspace; `out` (8,) gets the distance, the nearest points of
    a (3) and b (3) in the world, and the lower bound. The unit normal from a to b is −axis.
    """
    margin_a, margin_b = solids.size[a, 5], solids.size[b, 5]
    margin = margin_a + margin_b
    vx, vy, vz = axis[0], axis[1], axis[2]
    if vx * vx + vy * vy + vz * vz < 1e-24:
        vx = pose[a, 12] - pose[b, 12]
        vy = pose[a, 13] - pose[b, 13]
        vz = pose[a, 14] - pose[b, 14]
        if vx * vx + vy * vy + vz * vz < 1e-24:
            vx, vy, vz = 1.0, 0.0, 0.0
    lam, weight = s[0, 9:13], s[1, 9:13]
    count = 0
    hint_a = hint_b = np.int64(-1)
    pax = pay = paz = pbx = pby = pbz = 0.0
    lower, upper = -1e300, 1e300
    status = OPEN
    for _ in range(MAX_ITERATIONS):
        norm = np.sqrt(vx * vx + vy * vy + vz * vz)
        if norm < 1e-12:
            # The cores touch: nothing is left to converge.
            upper = norm - margin if norm - margin < upper else upper
            status = HIT
            break
        # Support of A along −v and of B along +v, found in the pieces' own frames.
        for side in range(2):
            p, sign = (a, -1.0) if side == 0 else (b, 1.0)
            x, y, z, hint = support(
                solids,
                p,
                sign * (pose[p, 0] * vx + pose[p, 3] * vy + pose[p, 6] * vz),
                sign * (pose[p, 1] * vx + pose[p, 4] * vy + pose[p, 7] * vz),
                sign * (pose[p, 2] * vx + pose[p, 5] * vy + pose[p, 8] * vz),
                hint_a if side == 0 else hint_b,
            )
            px = pose[p, 9] + pose[p, 0] * x + pose[p, 1] * y + pose[p, 2] * z
            py = pose[p, 10] + pose[p, 3] * x + pose[p, 4] * y + pose[p, 5] * z
            pz = pose[p, 11] + pose[p, 6] * x + pose[p, 7] * y + pose[p, 8] * z
            if side == 0:
                pax, pay, paz, hint_a = px, py, pz, hint
            else:
                pbx, pby, pbz, hint_b = px, py, pz, hint
        wx, wy, wz = pax - pbx, pay - pby, paz - pbz
        plane = (vx * wx + vy * wy + vz * wz) / norm - margin
        if plane > lower:
            lower = plane
            axis[0], axis[1], axis[2] = vx / norm, vy / norm, vz / norm
        if lower > above:
            status = FAR
            break
        if count > 0 and upper - lower <= GAP_M:
            status = SOLVED
            break
        repeated = False
        for k in range(count):
            if s[k, 0] == wx and s[k, 1] == wy and s[k, 2] == wz:
                repeated = True
        if repeated:
            break
        s[count, 0], s[count, 1], s[count, 2] = wx, wy, wz
        s[count, 3], s[count, 4], s[count, 5] = pax, pay, paz
        s[count, 6], s[count, 7], s[count, 8] = pbx, pby, pbz
        found = nearest(s, count + 1, lam, weight)
        if found == INSIDE:
            upper = -margin
            status = HIT
            break
        count = found
        vx = vy = vz = 0.0
        for k in range(count):
            vx += lam[k] * s[k, 0]
            vy += lam[k] * s[k, 1]
            vz += lam[k] * s[k, 2]
        now = np.sqrt(vx * vx + vy * vy + vz * vz) - margin
        stalled = now >= upper
        if now < upper:
            upper = now
        if upper <= below:
            status = HIT
            break
        if stalled:
            break
    if status == OPEN and count > 0 and upper - lower <= 1e3 * GAP_M:
        status = SOLVED
    out[0], out[7] = upper, lower
    if status == FAR:
        out[0] = lower
        return status
    for k in range(1, 7):
        out[k] = 0.0
    for k in range(count):
        for c in range(3):
            out[1 + c] += lam[k] * s[k, 3 + c]
            out[4 + c] += lam[k] * s[k, 6 + c]
    if status == SOLVED:
        norm = upper + margin
        for c in range(3):
            # The axis from the points themselves, unless they nearly coincide; then witness
            # points of the grown pieces.
            if norm > 1e-9:
                axis[c] = (out[1 + c] - out[4 + c]) / norm
            out[1 + c] -= margin_a * axis[c]
            out[4 + c] += margin_b * axis[c]
    return status
