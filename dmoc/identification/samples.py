"""From a log to samples that a regressor may use: one filter for positions and torques."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
from scipy.signal import butter, sosfiltfilt

from dmoc.arrays import Array, StaysReadonly
from dmoc.errors import InputError

#: Slower joints stick: any torque between the limits of stiction holds them [rad/s].
DEAD_ZONE_RAD_S = 0.005
#: Dropped at both ends, where the filter has no neighbours [s].
_EDGE_S = 0.1
#: Samples per period of the cut-off that are kept.
_PER_PERIOD = 5.0
#: Positions pass this many times the cut-off: derivatives need a filter, but one that moves
#: neither the reversals nor what the cut-off lets through.
_WIDER = 4.0


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
    """Filtered samples (M, n) of one run, `step_s` apart.

    `fine` is the run before filter and thinning, every `thin`-th of its rows a sample: what is not
    linear in the motion (a regressor's columns) is made there and then passes `low`.
    """

    name: str
    step_s: float
    q_rad: Array
    velocity_rad_s: Array
    acceleration_rad_s2: Array
    torque_nm: Array
    fine: Samples | None = None
    rows: npt.NDArray[np.int64] | None = None
    low: Array | None = None

    def filtered(self, values: Array) -> Array:
        """Values of the rows of `fine` (K, …) as the torques were filtered and thinned (M, …)."""
        smooth = values if self.low is None else sosfiltfilt(self.low, values, axis=0)
        return np.asarray(smooth[self.rows], dtype=np.float64)

    @property
    def moving(self) -> Array:
        """1 where a joint moves, 0 inside the dead zone or where the filter saw mostly that."""
        moves = np.abs(self.velocity_rad_s) >= DEAD_ZONE_RAD_S
        if self.fine is not None:
            moves &= self.filtered(self.fine.moving) > 0.5
        return moves.astype(float)


def samples_of(log: MotionLog, cutoff_hz: float = 10.0, torque_early_s: float = 0.0) -> Samples:
    """Evenly spaced, filtered and thinned samples; `torque_early_s` shifts the torque to earlier.

    Torques, and the columns made of the motion, pass the same Butterworth filter of fourth order,
    forwards and backwards; positions pass a wider one before their central differences.
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
    low = None
    if _WIDER * cutoff_hz < 0.45 / step:
        q = sosfiltfilt(butter(4, _WIDER * cutoff_hz, fs=1.0 / step, output="sos"), q, axis=0)
    if cutoff_hz < 0.45 / step:
        low = np.asarray(butter(4, cutoff_hz, fs=1.0 / step, output="sos"))
    velocity = np.gradient(q, step, axis=0)
    arrays = (q, velocity, np.gradient(velocity, step, axis=0), tau)
    thin = max(1, round(1.0 / (step * _PER_PERIOD * cutoff_hz)))
    edge = max(2, round(_EDGE_S / step))
    rows = np.arange(edge, len(even) - edge, thin)
    fine = Samples(log.name, step, *arrays)
    out = Samples(log.name, thin * step, *arrays, fine, rows, low)
    q, velocity, acceleration, tau = (out.filtered(a) for a in arrays)
    return Samples(log.name, thin * step, q, velocity, acceleration, tau, fine, rows, low)
