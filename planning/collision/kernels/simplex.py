"""The point of a simplex nearest to the origin: the inner step of GJK.

Rows of `s` (4, 9) are w = a − b, a, b. The routines leave the rows that carry the nearest point,
with their weights in `lam`, in front and return how many there are (5: the origin is inside).
Regions of points, edges and faces as in C. Ericson, Real-Time Collision Detection (2005), 5.1.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from dmoc.jit import njit

INSIDE = 5


@njit(plain=True, inner=True)
def _dot(s: Any, i: int, k: int) -> float:
    return s[i, 0] * s[k, 0] + s[i, 1] * s[k, 1] + s[i, 2] * s[k, 2]


@njit(plain=True, inner=True)
def _edge(s: Any, i: int, k: int, weight: Any) -> float:
    """Weights of rows i, k at the point of edge ik nearest to the origin; its squared norm."""
    ii, kk, ik = _dot(s, i, i), _dot(s, k, k), _dot(s, i, k)
    length = ii - 2.0 * ik + kk
    t = 0.0
    if length > 0.0:
        t = (ii - ik) / length
    t = 0.0 if t < 0.0 else (1.0 if t > 1.0 else t)
    weight[0], weight[1] = 1.0 - t, t
    total = 0.0
    for c in range(3):
        x = (1.0 - t) * s[i, c] + t * s[k, c]
        total += x * x
    return total


@njit(plain=True, inner=True)
def _triangle(s: Any, i: int, k: int, m: int, weight: Any) -> float:
    """Weights of rows i, k, m at the nearest point of the triangle; its squared norm."""
    abx, aby, abz = s[k, 0] - s[i, 0], s[k, 1] - s[i, 1], s[k, 2] - s[i, 2]
    acx, acy, acz = s[m, 0] - s[i, 0], s[m, 1] - s[i, 1], s[m, 2] - s[i, 2]
    nx, ny, nz = aby * acz - abz * acy, abz * acx - abx * acz, abx * acy - aby * acx
    nn = nx * nx + ny * ny + nz * nz
    ab2 = abx * abx + aby * aby + abz * abz
    ac2 = acx * acx + acy * acy + acz * acz
    # sin² of the corner's angle: a sliver's normal is rounding, its edges are not.
    if nn > 1e-20 * ab2 * ac2:
        # Barycentric weights of the origin's projection, from signed areas about the normal.
        u = _signed_area(s, k, m, nx, ny, nz) / nn
        v = _signed_area(s, m, i, nx, ny, nz) / nn
        w = 1.0 - u - v
        if u >= 0.0 and v >= 0.0 and w >= 0.0:
            weight[0], weight[1], weight[2] = u, v, w
            total = 0.0
            for c in range(3):
                x = u * s[i, c] + v * s[k, c] + w * s[m, c]
                total += x * x
            return total
    # Outside (or a sliver): the nearest point lies on an edge. A loop, not three calls: compiled
    # code grows with every inlined copy.
    best, b0, b1, b2 = 1e300, 0.0, 0.0, 0.0
    for e in range(3):
        first = i if e == 0 else (k if e == 1 else m)
        second = k if e == 0 else (m if e == 1 else i)
        other = _edge(s, first, second, weight)
        if other < best:
            best = other
            b0 = weight[0] if e == 0 else (0.0 if e == 1 else weight[1])
            b1 = weight[1] if e == 0 else (weight[0] if e == 1 else 0.0)
            b2 = 0.0 if e == 0 else (weight[1] if e == 1 else weight[0])
    weight[0], weight[1], weight[2] = b0, b1, b2
    return best


@njit(plain=True, inner=True)
def _signed_area(s: Any, i: int, k: int, nx: float, ny: float, nz: float) -> float:
    """(w_i × w_k) · n."""
    return (
        (s[i, 1] * s[k, 2] - s[i, 2] * s[k, 1]) * nx
        + (s[i, 2] * s[k, 0] - s[i, 0] * s[k, 2]) * ny
        + (s[i, 0] * s[k, 1] - s[i, 1] * s[k, 0]) * nz
    )


@njit(plain=True, inner=True)
def _volume(s: Any, i: int, k: int, m: int) -> float:
    """w_i · (w_k × w_m)."""
    return (
        s[i, 0] * (s[k, 1] * s[m, 2] - s[k, 2] * s[m, 1])
        + s[i, 1] * (s[k, 2] * s[m, 0] - s[k, 0] * s[m, 2])
        + s[i, 2] * (s[k, 0] * s[m, 1] - s[k, 1] * s[m, 0])
    )


@njit(plain=True, inner=True)
def nearest(s: Any, count: int, lam: Any, weight: Any) -> int:
    """Reduce `count` rows of `s` to those that carry the point nearest to the origin.

    Columns 9 to 12 of rows 2 and 3 are workspace.
    """
    if count == 1:
        lam[0] = 1.0
        return 1
    if count == 2:
        _edge(s, count - 2, count - 1, weight)
        lam[0], lam[1] = weight[0], weight[1]
    else:
        # Signed volumes of the tetrahedra that the origin makes with the faces (face f leaves row
        # f out): all of the sign of the whole means inside, and only faces of the other sign can
        # carry the nearest point. A triangle is the face that leaves out a fourth row.
        whole, size, flat = 1.0, 0.0, False
        for f in range(4):
            s[2, 9 + f] = 1.0 if f < 3 else -1.0
        if count == 4:
            whole = 0.0
            for f in range(4):
                a, b, c = 1 if f == 0 else 0, 2 if f <= 1 else 1, 3 if f <= 2 else 2
                volume = _volume(s, a, b, c)
                if f % 2 == 1:
                    volume = -volume
                s[2, 9 + f] = volume
                whole += volume
                size += abs(volume)
            # Four points in a plane enclose nothing, and the signs above are noise: try every face.
            flat = abs(whole) <= 1e-14 * size
        best = 1e300
        for f in range(4):
            if not flat and s[2, 9 + f] * whole > 0.0:
                continue
            a, b, c = 1 if f == 0 else 0, 2 if f <= 1 else 1, 3 if f <= 2 else 2
            if c >= count:
                continue
            other = _triangle(s, a, b, c, weight)
            if other < best:
                best = other
                for row in range(count):
                    lam[row] = 0.0
                lam[a], lam[b], lam[c] = weight[0], weight[1], weight[2]
        if best == 1e300:
            return INSIDE
    kept: Any = np.int64(0)
    for i in range(count):
        if lam[i] > 0.0:
            if i != kept:
                for c in range(9):
                    s[kept, c] = s[i, c]
            lam[kept] = lam[i]
            kept += 1
    return kept
