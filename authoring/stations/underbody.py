"""A car-underbody-like sheet: height field, its triangle mesh and the convex prisms that cover it.

z(x, y) = 0.80 + max(tunnel(x) + member(y), sill(x), dash(y), kick-up(y)) over x 1.12–2.70,
y ±1.22 [m]; tunnel, sills, dash and kick-up are trapezoids, the cross member a bell
0.05 exp(−((y + 0.2)/0.06)²). Grid lines lie at the same heights on all ramps, so the valleys
between two ramps run along cell diagonals and the mesh equals the height field there.
"""

from __future__ import annotations

import itertools

import numpy as np
import numpy.typing as npt

from dmoc.arrays import Array

X_M, Y_M, FLOOR_M = (1.12, 2.70), (-1.22, 1.22), 0.80
SHEET_M = 0.003
BOTTOM_M = 0.74
_LEVELS = (0.0, 0.005, 0.01, 0.02, 0.03, 0.04, 0.05, 0.10, 0.15, 0.20, 0.22, 0.24, 0.30)

# Ramps: (coordinate at floor height, coordinate at full height, height).
_TUNNEL = ((1.69, 1.77, 0.22), (2.11, 2.03, 0.22))
_SILLS = ((1.22, 1.16, 0.20), (2.58, 2.64, 0.20))
_DASH, _KICK = (1.02, 1.14, 0.30), (-0.98, -1.12, 0.24)
_MEMBER_Y, _MEMBER_WIDTH, _MEMBER_TOP, _MEMBER_END = -0.20, 0.06, 0.05, 0.15


def _ramp_lines(ramp: tuple[float, float, float]) -> list[float]:
    foot, top, height = ramp
    return [foot + level / height * (top - foot) for level in _LEVELS if level <= height]


def _member_lines() -> tuple[Array, Array]:
    """y lines of the cross member and its height on them (linear in between)."""
    levels = [level for level in _LEVELS if 0.0 < level < _MEMBER_TOP]
    reach = [_MEMBER_WIDTH * np.sqrt(np.log(_MEMBER_TOP / level)) for level in levels]
    side = [*reversed(reach), 0.0]
    offsets = np.array(
        [-_MEMBER_END, *(-np.array(sorted(side, reverse=True))), *sorted(reach), _MEMBER_END]
    )
    heights = np.array([0.0, *levels, _MEMBER_TOP, *reversed(levels), 0.0])
    return _MEMBER_Y + offsets, heights


def _ramp(coordinate: Array, ramp: tuple[float, float, float]) -> Array:
    foot, top, height = ramp
    return height * np.clip((coordinate - foot) / (top - foot), 0.0, 1.0)


def height_m(x: Array, y: Array) -> Array:
    """z of the sheet's upper side [m]."""
    tunnel = np.minimum(_ramp(x, _TUNNEL[0]), _ramp(x, _TUNNEL[1]))
    member = np.interp(y, *_member_lines())
    sill = np.maximum(_ramp(x, _SILLS[0]), _ramp(x, _SILLS[1]))
    end = np.maximum(_ramp(y, _DASH), _ramp(y, _KICK))
    return FLOOR_M + np.maximum(np.maximum(tunnel + member, sill), end)


def _lines() -> tuple[Array, Array]:
    x = [*X_M, *np.linspace(1.22, 1.69, 6), *np.linspace(2.11, 2.58, 6), 1.855, 1.945]
    for ramp in (*_TUNNEL, *_SILLS):
        x += _ramp_lines(ramp)
    y = [*Y_M, *np.linspace(-0.98, -0.35, 9), *np.linspace(-0.05, 1.02, 14), *_member_lines()[0]]
    for ramp in (_DASH, _KICK):
        y += _ramp_lines(ramp)
    return np.unique(np.round(x, 7)), np.unique(np.round(y, 7))


def mesh() -> tuple[Array, npt.NDArray[np.int64]]:
    """Vertices (V, 3) [m] and faces (F, 3) of the closed sheet: upper side, lower side, rim."""
    x, y = _lines()
    grid_x, grid_y = np.meshgrid(x, y, indexing="ij")
    top = height_m(grid_x, grid_y)
    nx, ny = top.shape
    middle = height_m(
        0.5 * (grid_x[1:, 1:] + grid_x[:-1, :-1]), 0.5 * (grid_y[1:, 1:] + grid_y[:-1, :-1])
    )
    index = np.arange(nx * ny).reshape(nx, ny)
    a, b, c, d = index[:-1, :-1], index[1:, :-1], index[1:, 1:], index[:-1, 1:]
    # The diagonal whose middle is nearer to the surface: a–c, or b–d.
    height_ac = 0.5 * (top[:-1, :-1] + top[1:, 1:]) - middle
    height_bd = 0.5 * (top[1:, :-1] + top[:-1, 1:]) - middle
    use_ac = np.abs(height_ac) <= np.abs(height_bd) + 1e-12
    upper = np.concatenate(
        [
            np.stack([np.where(use_ac, a, a), b, np.where(use_ac, c, d)], axis=-1).reshape(-1, 3),
            np.stack([np.where(use_ac, a, b), c, d], axis=-1).reshape(-1, 3),
        ]
    )
    ring = np.concatenate([index[:, 0], index[-1, 1:], index[-2::-1, -1], index[0, -2:0:-1]])
    following, below = np.roll(ring, -1), nx * ny
    rim = np.concatenate(
        [
            np.stack([ring, ring + below, following], axis=1),
            np.stack([following, ring + below, following + below], axis=1),
        ]
    )
    flat = np.stack([grid_x.ravel(), grid_y.ravel(), top.ravel()], axis=1)
    vertices = np.round(np.concatenate([flat, flat - [0.0, 0.0, SHEET_M]]), 6)
    return vertices, np.concatenate([upper, upper[:, ::-1] + below, rim])


def prisms() -> tuple[tuple[str, Array], ...]:
    """Named convex pieces (points (V, 3)) that cover the sheet and all below it to z = 0.74."""
    y_lines, member = _member_lines()
    pieces: list[tuple[str, Array]] = []

    def prism(name: str, x: list[float], y: list[float], z: list[list[float]]) -> None:
        """Hull of the points (x_i, y_j, z_ij) and their feet."""
        grid_x, grid_y = np.meshgrid(x, y, indexing="ij")
        tops = np.stack([grid_x, grid_y, FLOOR_M + np.array(z)], axis=-1).reshape(-1, 3)
        feet = tops.copy()
        feet[:, 2] = BOTTOM_M
        pieces.append((name, np.concatenate([tops, feet])))

    x0, x1, y0, y1 = *X_M, *Y_M
    prism("floor", [x0, x1], [y0, y1], [[0.0, 0.0], [0.0, 0.0]])
    section = [(1.69, 0.0), (1.77, 0.22), (2.03, 0.22), (2.11, 0.0)]
    # The tunnel carries the cross member, so it is cut where the bell turns from hollow to round.
    inner = [y_lines[0], y_lines[2], y_lines[4], y_lines[-5], y_lines[-3], y_lines[-1]]
    for number, (low, high) in enumerate(itertools.pairwise(inner)):
        part = (y_lines >= low - 1e-9) & (y_lines <= high + 1e-9)
        y, bump = list(y_lines[part]), list(member[part])
        for name, outline in (
            ("left", [(x0, 0.0), (1.69, 0.0)]),
            ("tunnel", section),
            ("right", [(2.11, 0.0), (x1, 0.0)]),
        ):
            prism(
                f"member_{name}_{number}",
                [p[0] for p in outline],
                y,
                [[p[1] + b for b in bump] for p in outline],
            )
    for name, low, high in (("front", y0, y_lines[0]), ("rear", y_lines[-1], y1)):
        prism(
            f"tunnel_{name}", [p[0] for p in section], [low, high], [[p[1], p[1]] for p in section]
        )
    for name, edge, ramp in (("left", x0, _SILLS[0]), ("right", x1, _SILLS[1])):
        foot, top, height = ramp
        prism(f"sill_{name}", [edge, top, foot], [y0, y1], [[height] * 2, [height] * 2, [0.0] * 2])
    for name, edge, ramp in (("dash", y1, _DASH), ("kick_up", y0, _KICK)):
        foot, top, height = ramp
        prism(name, [x0, x1], [edge, top, foot], [[height, height, 0.0]] * 2)
    return tuple(pieces)
