"""From a log to samples that a regressor may use: one filter for positions and torques."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.signal import butter, sosfiltfilt

from dmoc.arrays import Array, StaysReadonly
from dmoc.errors import InputError

#: Slower joints stick: any torque between the limits of stiction holds them [rad/s].
DEAD_ZONE_RAD_S = 0.005
#: Dropped at both ends, where the filter has no neighbours [s].
_EDGE_S = 0.1
#: Samples per period of the cut-off that are kept.
_PER_PERIOD = 5.0


@dataclass(frozen=True, eq=False)
class MotionLog(StaysReadonly):
    """Joint positions (K, n) [rad] and joint torques (K, n) [N·m] at times (K,) [s]."""

    name: str
    t_s: Array
    q_rad: Array
    torque_nm: Array
    sha256: str = ""


@dataclass(frozen=True, eq=False)
class Samples(StaysReadonly):
    """Filtered samples (M, n) of one run, `step_s` apart."""

    name: str
    step_s: float
    q_rad: Array
    velocity_rad_s: Array
    acceleration_rad_s2: Array
    torque_nm: Array

    @property
    def moving(self) -> Array:
        """1 where a joint moves, 0 inside the dead zone (M, n)."""
        return (np.abs(self.velocity_rad_s) >= DEAD_ZONE_RAD_S).astype(float)

    def between(self, start_s: float, end_s: float) -> Samples:
        """The part of this run between two times after its first sample."""
        first, last = round(start_s / self.step_s), round(end_s / self.step_s)
        rows = slice(max(first, 0), last)
        arrays = (self.q_rad, self.velocity_rad_s, self.acceleration_rad_s2, self.torque_nm)
        return Samples(self.name, self.step_s, *(a[rows] for a in arrays))


def samples_of(log: MotionLog, cutoff_hz: float = 10.0, torque_early_s: float = 0.0) -> Samples:
    """Evenly spaced, filtered and thinned samples; `torque_early_s` shifts the torque to earlier.

    Positions and torques pass the same Butterworth filter of fourth order, forwards and backwards;
    derivatives are central differences of the filtered positions.
    Errors: `InputError` (log-short) for less than a second.
    """
    step = float(np.median(np.diff(log.t_s)))
    even = np.arange(0.0, log.t_s[-1] - log.t_s[0] + step / 2, step)
    if even[-1] < 1.0:
        legal, fix = ">= 1 s (20 s of rich motion are enough)", "record a longer motion"
        raise InputError.of("log-short", log.name, "timestamp", f"{even[-1]:.3g} s", legal, fix)
    stamp = log.t_s - log.t_s[0]
    joints = range(log.q_rad.shape[1])
    q = np.column_stack([np.interp(even, stamp, log.q_rad[:, j]) for j in joints])
    late = even + torque_early_s
    tau = np.column_stack([np.interp(late, stamp, log.torque_nm[:, j]) for j in joints])
    if cutoff_hz < 0.45 / step:
        low = butter(4, cutoff_hz, fs=1.0 / step, output="sos")
        q, tau = sosfiltfilt(low, q, axis=0), sosfiltfilt(low, tau, axis=0)
    velocity = np.gradient(q, step, axis=0)
    acceleration = np.gradient(velocity, step, axis=0)
    thin = max(1, round(1.0 / (step * _PER_PERIOD * cutoff_hz)))
    edge = max(2, round(_EDGE_S / step))
    rows = slice(edge, len(even) - edge, thin)
    return Samples(log.name, thin * step, q[rows], velocity[rows], acceleration[rows], tau[rows])
