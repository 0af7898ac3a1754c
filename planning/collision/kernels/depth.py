"""Penetration depth of two convex pieces: the expanding polytope algorithm, from any start.

The least translation that separates A and B is the least value of the support function
h(n) = max_{w ∈ A−B} n·w over unit n. A polytope inside A − B grows at its face with the least
signed offset from the origin (G. van den Bergen, 2001); offsets may be negative at first, so the
start needs not hold the origin. Any h(n) tried separates the pieces, so the answer is never
too shallow; at convergence the face's offset proves that it is not too deep either.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt

from dmoc.jit import njit
from planning.collision.kernels.distance import FAR, HIT, SOLVED, gjk, support

MOST_POINTS = 100
MOST_FACES = 4 * MOST_POINTS
TOLERANCE_M = 1e-9
FLAT_M = 1e-10


class Grown(NamedTuple):
    """Workspace of the growing polytope; every call overwrites what it reads."""

    points: npt.NDArray[np.float64]
    spare: npt.NDArray[np.float64]
    corner: npt.NDArray[np.int64]
    face: npt.NDArray[np.float64]
    edge: npt.NDArray[np.int64]


def grown_workspace() -> Grown:
    """A new workspace."""
    return Grown(
        np.empty((MOST_POINTS + 4, 9)),
        np.empty((2, 9)),
        np.empty((MOST_FACES, 3), dtype=np.int64),
        np.empty((MOST_FACES, 4)),
        np.empty((MOST_FACES, 2), dtype=np.int64),
    )


@njit(plain=True, inner=True)
def _corner(
    solids: Any, pose: Any, a: int, b: int, nx: float, ny: float, nz: float, row: Any
) -> float:
    """The point of A − B farthest along n, as w, a, b in `row` (9,); returns n·w."""
    no_hint = np.int64(-1)
    for side in range(2):
        p, sign = (a, 1.0) if side == 0 else (b, -1.0)
        x, y, z, _ = support(
            solids,
            p,
            sign * (pose[p, 0] * nx + pose[p, 3] * ny + pose[p, 6] * nz),
            sign * (pose[p, 1] * nx + pose[p, 4] * ny + pose[p, 7] * nz),
            sign * (pose[p, 2] * nx + pose[p, 5] * ny + pose[p, 8] * nz),
            no_hint,
        )
        at = 3 + 3 * side
        row[at] = pose[p, 9] + pose[p, 0] * x + pose[p, 1] * y + pose[p, 2] * z
        row[at + 1] = pose[p, 10] + pose[p, 3] * x + pose[p, 4] * y + pose[p, 5] * z
        row[at + 2] = pose[p, 11] + pose[p, 6] * x + pose[p, 7] * y + pose[p, 8] * z
    for c in range(3):
        row[c] = row[3 + c] - row[6 + c]
    return row[0] * nx + row[1] * ny + row[2] * nz


@njit(plain=True, inner=True)
def _plane(w: Any, i: int, k: int, m: int, face: Any) -> bool:
    """Unit normal and offset of the plane through rows i, k, m; False for a sliver."""
    ax, ay, az = w[k, 0] - w[i, 0], w[k, 1] - w[i, 1], w[k, 2] - w[i, 2]
    bx, by, bz = w[m, 0] - w[i, 0], w[m, 1] - w[i, 1], w[m, 2] - w[i, 2]
    nx, ny, nz = ay * bz - az * by, az * bx - ax * bz, ax * by - ay * bx
    norm = np.sqrt(nx * nx + ny * ny + nz * nz)
    reach, other = ax * ax + ay * ay + az * az, bx * bx + by * by + bz * bz
    if other > reach:
        reach = other
    if norm <= 1e-12 * reach or norm == 0.0:
        return False
    face[0], face[1], face[2] = nx / norm, ny / norm, nz / norm
    face[3] = face[0] * w[i, 0] + face[1] * w[i, 1] + face[2] * w[i, 2]
    return True


@njit(plain=True, inner=True)
def _first_simplex(solids: Any, pose: Any, a: int, b: int, w: Any, spare: Any, face: Any) -> bool:
    """Four corners far apart in rows 0–3; False if A − B is flat, with its normal in `face`."""
    ex = ey = ez = ux = uy = uz = vx = vy = vz = dx = dy = dz = 0.0
    widest, farthest, highest, low = -1.0, -1.0, -1.0, 0.0
    zero = np.int64(0)
    # One loop, not four: compiled code grows with every inlined copy of `_corner`. Steps 0–5 look
    # both ways along x, y, z, 6–9 along two directions across the line 0–1, 10 and 11 along the
    # normal of the plane 0–1–2.
    for step in range(12):
        sign = 1.0 if step % 2 == 0 else -1.0
        if step < 6:
            dx, dy, dz = (
                sign if step // 2 == 0 else 0.0,
                sign if step // 2 == 1 else 0.0,
                sign if step // 2 == 2 else 0.0,
            )
        elif step < 8:
            dx, dy, dz = sign * ux, sign * uy, sign * uz
        elif step < 10:
            dx, dy, dz = sign * vx, sign * vy, sign * vz
        else:
            dx, dy, dz = sign * face[0], sign * face[1], sign * face[2]
        row = spare[step % 2]
        high = _corner(solids, pose, a, b, dx, dy, dz, row)
        if step < 6:
            if step % 2 == 0:
                low = high
            elif low + high > widest:
                widest = low + high
                for k in range(9):
                    w[0, k], w[1, k] = spare[0, k], spare[1, k]
        elif step < 10:
            px, py, pz = row[0] - w[0, 0], row[1] - w[0, 1], row[2] - w[0, 2]
            along = px * ex + py * ey + pz * ez
            far = px * px + py * py + pz * pz - along * along
            if far > farthest:
                farthest = far
                for k in range(9):
                    w[2, k] = row[k]
        elif high - sign * face[3] > highest:
            highest = high - sign * face[3]
            for k in range(9):
                w[3, k] = row[k]
        if step == 5:
            ex, ey, ez = w[1, 0] - w[0, 0], w[1, 1] - w[0, 1], w[1, 2] - w[0, 2]
            length = np.sqrt(ex * ex + ey * ey + ez * ez)
            if length <= FLAT_M:
                face[0], face[1], face[2] = 1.0, 0.0, 0.0
                return False
            ex, ey, ez = ex / length, ey / length, ez / length
            # Across: e × the axis that e is least along.
            ux, uy, uz = 0.0, ez, -ey
            if abs(ey) <= abs(ex) and abs(ey) <= abs(ez):
                ux, uy, uz = -ez, 0.0, ex
            elif abs(ez) <= abs(ex) and abs(ez) <= abs(ey):
                ux, uy, uz = ey, -ex, 0.0
            norm = np.sqrt(ux * ux + uy * uy + uz * uz)
            ux, uy, uz = ux / norm, uy / norm, uz / norm
            vx, vy, vz = ey * uz - ez * uy, ez * ux - ex * uz, ex * uy - ey * ux
        if step == 9 and (
            farthest <= FLAT_M * FLAT_M or not _plane(w, zero, zero + 1, zero + 2, face)
        ):
            face[0], face[1], face[2] = ux, uy, uz
            return False
    return highest > FLAT_M


@njit(plain=True, inner=True)
def _witness(
    w: Any, corner: Any, face: Any, margins: tuple[float, float], high: float, out: Any, normal: Any
) -> None:
    """Distance, nearest points and normal from the face whose support is `high`."""
    i, k, m = corner[0], corner[1], corner[2]
    margin_a, margin_b = margins
    px, py, pz = face[0] * face[3], face[1] * face[3], face[2] * face[3]
    # Areas of the triangles that the origin's projection makes with the edges, as weights.
    total = 0.0
    for c in range(3):
        first = k if c == 0 else (m if c == 1 else i)
        second = m if c == 0 else (i if c == 1 else k)
        ax, ay, az = w[first, 0] - px, w[first, 1] - py, w[first, 2] - pz
        bx, by, bz = w[second, 0] - px, w[second, 1] - py, w[second, 2] - pz
        area = (
            (ay * bz - az * by) * face[0]
            + (az * bx - ax * bz) * face[1]
            + (ax * by - ay * bx) * face[2]
        )
        if area < 0.0:
            area = 0.0
        normal[c] = area  # for a moment, the weights
        total += area
    u, v, t = normal[0], normal[1], normal[2]
    if total <= 0.0:
        u, total = 1.0, 1.0
    out[0] = out[7] = -high - margin_a - margin_b
    for c in range(3):
        normal[c] = face[c]
        out[1 + c] = (
            u * w[i, 3 + c] + v * w[k, 3 + c] + t * w[m, 3 + c]
        ) / total + margin_a * face[c]
        # From a along the normal, so that distance = normal · (point_b − point_a) exactly.
        out[4 + c] = out[1 + c] + out[0] * face[c]


@njit(plain=True, inner=True)
def overlap_depth(
    solids: Any, pose: Any, a: int, b: int, grown: Any, out: Any, normal: Any
) -> None:
    """Signed distance of overlapping pieces a, b [m], as `gjk` writes it.

    `out` (8,): distance (negative: depth), nearest points of a (3) and b (3) in the world, and the
    distance again; `normal` (3,): unit, from a to b. For pieces that are apart it is the gap along
    the best normal tried: a lower bound of the distance. `grown` is the workspace.
    """
    w, spare, corner = grown.points, grown.spare, grown.corner
    face, edge = grown.face, grown.edge
    margins = (solids.size[a, 5], solids.size[b, 5])
    flat = not _first_simplex(solids, pose, a, b, w, spare, face[0])
    zero: Any = np.int64(0)
    points, faces = 4, 0
    if flat:
        # A − B has no inside: the depth of the cores is nothing, along the normal of the flat.
        for c in range(3):
            face[1, c] = -face[0, c]
    for f in range(4):
        i, k, m = (1 if f == 0 else 0), (2 if f <= 1 else 1), (3 if f <= 2 else 2)
        if flat or not _plane(w, i, k, m, face[faces]):
            continue
        away = face[faces, 0] * w[f, 0] + face[faces, 1] * w[f, 1] + face[faces, 2] * w[f, 2]
        if away > face[faces, 3]:  # the fourth corner lies inside
            k, m = m, k
            for c in range(4):
                face[faces, c] = -face[faces, c]
        corner[faces, 0], corner[faces, 1], corner[faces, 2] = i, k, m
        faces += 1
    best = 1e300
    while points < MOST_POINTS:
        f = points - 4 if flat else zero
        for other in range(1, faces):
            if face[other, 3] < face[f, 3]:
                f = other
        high = _corner(solids, pose, a, b, face[f, 0], face[f, 1], face[f, 2], w[points])
        if flat:
            face[f, 3] = high
            corner[f, 0] = corner[f, 1] = corner[f, 2] = points
        if high < best:
            best = high
            _witness(w, corner[f], face[f], margins, high, out, normal)
        if flat and points == 4:
            points += 1
            continue
        if flat or best - face[f, 3] <= TOLERANCE_M:
            return
        # Faces that the new corner sees go; the edges between seen and unseen get new faces.
        edges, kept = 0, 0
        for g in range(faces):
            x, y, z = w[points, 0], w[points, 1], w[points, 2]
            seen = face[g, 0] * x + face[g, 1] * y + face[g, 2] * z - face[g, 3] > 1e-13
            if not seen and g != f:
                if kept != g:
                    for c in range(3):
                        corner[kept, c] = corner[g, c]
                    for c in range(4):
                        face[kept, c] = face[g, c]
                kept += 1
                continue
            for c in range(3):
                i, k = corner[g, c], corner[g, (c + 1) % 3]
                shared = -1
                for e in range(edges):
                    if edge[e, 0] == k and edge[e, 1] == i:
                        shared = e
                if shared >= 0:
                    edges -= 1
                    edge[shared, 0], edge[shared, 1] = edge[edges, 0], edge[edges, 1]
                else:
                    edge[edges, 0], edge[edges, 1] = i, k
                    edges += 1
        faces = kept
        for e in range(edges):
            i, k = edge[e, 0], edge[e, 1]
            if faces >= MOST_FACES or not _plane(w, i, k, points, face[faces]):
                return  # a sliver: rounding decides now, and the best normal so far is kept
            corner[faces, 0], corner[faces, 1], corner[faces, 2] = i, k, points
            faces += 1
        points += 1


@njit(plain=True, inner=True)
def signed_distance(
    solids: Any,
    pose: Any,
    a: int,
    b: int,
    axis: Any,
    above: float,
    s: Any,
    grown: Any,
    out: Any,
    normal: Any,
) -> bool:
    """Distance of apart pieces, minus the depth of overlapping ones; False: beyond `above` [m].

    `axis` and `s` are those of `gjk`, `grown`, `out` and `normal` those of `overlap_depth`. Where
    the bounds of `gjk` do not meet, the larger of the two lower bounds stands.
    """
    status = gjk(solids, pose, a, b, axis, above, -1e300, s, out)
    if status == FAR:
        return False
    for c in range(3):
        normal[c] = -axis[c]
    if status == SOLVED:
        return True
    lower = out[7]
    overlap_depth(solids, pose, a, b, grown, out, axis)
    if status == HIT or out[0] >= lower:
        for c in range(3):
            normal[c] = axis[c]
    else:
        out[0] = lower
    for c in range(3):
        axis[c] = -normal[c]
    return True
