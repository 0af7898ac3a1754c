r"""A shared DC link: capacitor, rectifier that never feeds back, brake chopper.

State is the capacitor's energy W = C V^2 / 2. The axes draw e_k = \int P dt [J] in step k:

    y_k = W_k - e_k
    grid_k = max(0, W_min - y_k),  chopper_k = max(0, y_k - W_max),
    W_{k+1} = min(max(y_k, W_min), W_max)

with W_min at the supply voltage and W_max at the chopper's threshold. Drawing grid_k costs
(1 + 2 V_f / V) grid_k at the rectifier's input. The cost of a schedule is

    J = (1 + 2 V_f / V) (sum_k grid_k - (W_K - W_0)),

so energy left in the capacitor is credited at the price it was bought for. J >= 0 may fail only
when the link starts charged. The gradient dJ/de_k is the *price* of energy in step k: it is
(1 + 2 V_f/V) if the next limit to be hit is the supply, 0 if it is the chopper.

The clip model is an ideal chopper. `simulate_hysteresis` switches a resistor on at `chopper_v` and
off at `chopper_off_v`, as drives do; results are reported with it, gradients use the clip model.
"""

# mypy: disallow-untyped-defs=False

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from dmoc.errors import Fault, InputError
from dmoc.jit import njit


@dataclass(frozen=True)
class LinkParams:
    """One DC link; defaults are of a 560 V drive system with one capacitor bank.

    capacitance_f, supply voltage_v and the drop of one diode rectifier_drop_v; the chopper burns
    in chopper_ohm from chopper_v down to chopper_off_v. Published: chopper band and voltages of
    KR C4 and AX8000 class hardware; assumed: capacitance, resistor, diode drop.
    """

    capacitance_f: float = 3e-3
    voltage_v: float = 560.0
    chopper_v: float = 760.0
    chopper_off_v: float = 740.0
    chopper_ohm: float = 22.0
    rectifier_drop_v: float = 1.0

    def __post_init__(self) -> None:
        faults = [
            Fault("link-value", "", f"link.{name}", str(getattr(self, name)), "finite, > 0")
            for name in ("capacitance_f", "voltage_v", "chopper_v", "chopper_off_v", "chopper_ohm")
            if not (np.isfinite(getattr(self, name)) and getattr(self, name) > 0)
        ]
        if not 0 <= self.rectifier_drop_v < self.voltage_v:
            value = str(self.rectifier_drop_v)
            faults.append(Fault("link-value", "", "link.rectifier_drop_v", value, ">= 0"))
        if not faults and not self.voltage_v < self.chopper_off_v <= self.chopper_v:
            value = f"{self.voltage_v}, {self.chopper_off_v}, {self.chopper_v}"
            legal = "voltage_v < chopper_off_v <= chopper_v"
            fix = "raise the chopper's thresholds above the supply voltage"
            faults.append(Fault("link-order", "", "link.chopper_v", value, legal, fix))
        if faults:
            raise InputError(faults)

    @property
    def min_energy_j(self) -> float:
        """Capacitor energy at the supply voltage."""
        return 0.5 * self.capacitance_f * self.voltage_v**2

    @property
    def max_energy_j(self) -> float:
        """Capacitor energy at the chopper's threshold."""
        return 0.5 * self.capacitance_f * self.chopper_v**2

    @property
    def grid_factor(self) -> float:
        """Grid energy per joule delivered to the link."""
        return 1.0 + 2.0 * self.rectifier_drop_v / self.voltage_v


@dataclass(frozen=True)
class LinkRun:
    """Energies of each step (K,) [J] and the capacitor's energy at the step ends (K+1,) [J].

    `grid_j` is what the link received from the rectifier (without the rectifier's loss),
    `energy_j` the grid energy of the whole run, rectifier loss included, end energy credited.
    """

    grid_j: np.ndarray
    chopper_j: np.ndarray
    stored_j: np.ndarray
    energy_j: float


@njit
def price_kernel(drawn, low, high, start, factor, price):
    """Fill price (K,) = dJ/d drawn and return J; one forward and one backward pass."""
    w = start
    bought = 0.0
    steps = drawn.shape[0]
    for k in range(steps):
        y = w - drawn[k]
        if y < low:
            bought += low - y
            w = low
            price[k] = 1.0
        elif y > high:
            w = high
            price[k] = 0.0
        else:
            w = y
            price[k] = -1.0  # inherits the price of what happens next
    later = factor
    for k in range(steps - 1, -1, -1):
        if price[k] == 1.0:
            later = factor
        elif price[k] == 0.0:
            later = 0.0
        price[k] = later
    return factor * (bought - (w - start))


@njit
def hysteresis_kernel(drawn, dt, low, on, off, rate, grid, chopper, stored):
    """Fill grid, chopper (K,) and stored (K+1,) [J], starting at `low`.

    The resistor is on from `on` down to `off`; rate = 2/(R C).
    """
    w = low
    burning = False
    stored[0] = w
    decay = np.exp(-rate * dt)
    for k in range(drawn.shape[0]):
        p = drawn[k] / dt
        left = dt
        burnt = 0.0
        bought = 0.0
        # Within a step power is constant, so every event time is closed form.
        for _ in range(64):
            if left <= 0.0:
                break
            if burning:
                # dW/dt = -p - rate W: W(t) = (W + p/rate) exp(-rate t) - p/rate
                e = decay if left == dt else np.exp(-rate * left)
                end = (w + p / rate) * e - p / rate
                spent = left
                if end < off:
                    ratio = (off + p / rate) / (w + p / rate)
                    spent = -np.log(ratio) / rate
                    if spent > left:
                        spent = left
                    end = off
                    burning = False
                burnt += w - end - p * spent
                w = end
                left -= spent
            elif p > 0.0:
                spent = min(left, max(0.0, (w - low) / p))
                w -= p * spent
                left -= spent
                if left > 0.0:  # the rectifier carries the rest of the step
                    w = low
                    bought += p * left
                    left = 0.0
            else:
                end = w - p * left
                if end <= on or p == 0.0:
                    w = end
                    left = 0.0
                else:
                    spent = (w - on) / p
                    w = on
                    left -= spent
                    burning = True
        grid[k] = bought
        chopper[k] = burnt
        stored[k + 1] = w


def simulate_hysteresis(drawn_j: np.ndarray, step_s: float, link: LinkParams) -> LinkRun:
    """Run the switched-resistor model, power constant within a step of `step_s` [s].

    Between events the capacitor's energy has a closed form, so the step size only limits how
    finely the power is resolved. If braking power exceeds V^2/R, the voltage rises above
    `chopper_v`, as it would.
    """
    drawn = np.ascontiguousarray(drawn_j, dtype=float)
    grid, chopper = np.empty_like(drawn), np.empty_like(drawn)
    stored = np.empty(drawn.size + 1)
    low, on = link.min_energy_j, link.max_energy_j
    off = 0.5 * link.capacitance_f * link.chopper_off_v**2
    rate = 2.0 / (link.chopper_ohm * link.capacitance_f)
    hysteresis_kernel(drawn, step_s, low, on, off, rate, grid, chopper, stored)
    for array in (grid, chopper, stored):
        array.setflags(write=False)
    credit = stored[-1] - stored[0]
    return LinkRun(grid, chopper, stored, float(link.grid_factor * (grid.sum() - credit)))
