"""Distances of TSPLIB: every EDGE_WEIGHT_TYPE over coordinates (Reinelt 1995)."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np


def _nint(x: np.ndarray) -> np.ndarray:
    return np.floor(x + 0.5)


def _differences(xyz: np.ndarray) -> np.ndarray:
    return np.abs(xyz[:, None, :] - xyz[None, :, :])


def euclidean(xyz: np.ndarray) -> np.ndarray:
    """EUC_2D and EUC_3D: rounded Euclidean distance."""
    return _nint(np.sqrt((_differences(xyz) ** 2).sum(axis=2)))


def ceiling(xyz: np.ndarray) -> np.ndarray:
    """CEIL_2D: Euclidean distance rounded up."""
    return np.ceil(np.sqrt((_differences(xyz) ** 2).sum(axis=2)))


def manhattan(xyz: np.ndarray) -> np.ndarray:
    """MAN_2D and MAN_3D."""
    return _nint(_differences(xyz).sum(axis=2))


def maximum(xyz: np.ndarray) -> np.ndarray:
    """MAX_2D and MAX_3D: the largest of the rounded coordinate differences."""
    return _nint(_differences(xyz)).max(axis=2)


def pseudo_euclidean(xyz: np.ndarray) -> np.ndarray:
    """ATT: sqrt(d²/10), rounded up to the next whole number that is not below it."""
    exact = np.sqrt((_differences(xyz) ** 2).sum(axis=2) / 10.0)
    rounded = _nint(exact)
    return np.where(rounded < exact, rounded + 1, rounded)


def geographical(xyz: np.ndarray) -> np.ndarray:
    """GEO: kilometres on TSPLIB's sphere; coordinates are degrees.minutes."""
    degrees = np.trunc(xyz)
    minutes = xyz - degrees
    radians = 3.141592 * (degrees + 5.0 * minutes / 3.0) / 180.0
    latitude, longitude = radians[:, 0], radians[:, 1]
    q1 = np.cos(longitude[:, None] - longitude[None, :])
    q2 = np.cos(latitude[:, None] - latitude[None, :])
    q3 = np.cos(latitude[:, None] + latitude[None, :])
    argument = 0.5 * ((1.0 + q1) * q2 - (1.0 - q1) * q3)
    return np.trunc(6378.388 * np.arccos(np.clip(argument, -1.0, 1.0)) + 1.0)


def crystallography_1(xyz: np.ndarray) -> np.ndarray:
    """XRAY1: time of the slowest motor of a diffractometer, in hundredths."""
    return _nint(100.0 * _motor_times(xyz, 1.0, 1.0, 1.0))


def crystallography_2(xyz: np.ndarray) -> np.ndarray:
    """XRAY2: as XRAY1 with other motor speeds."""
    return _nint(100.0 * _motor_times(xyz, 1.25, 1.5, 1.15))


def _motor_times(xyz: np.ndarray, phi: float, chi: float, theta: float) -> np.ndarray:
    delta = _differences(xyz)
    turn = np.minimum(delta[:, :, 0], np.abs(delta[:, :, 0] - 360.0))
    return np.maximum(np.maximum(turn / phi, delta[:, :, 1] / chi), delta[:, :, 2] / theta)


# EDGE_WEIGHT_TYPE: (number of coordinates, distance)
METRICS: dict[str, tuple[int, Callable[[np.ndarray], np.ndarray]]] = {
    "EUC_2D": (2, euclidean),
    "EUC_3D": (3, euclidean),
    "MAX_2D": (2, maximum),
    "MAX_3D": (3, maximum),
    "MAN_2D": (2, manhattan),
    "MAN_3D": (3, manhattan),
    "CEIL_2D": (2, ceiling),
    "GEO": (2, geographical),
    "ATT": (2, pseudo_euclidean),
    "XRAY1": (3, crystallography_1),
    "XRAY2": (3, crystallography_2),
}
