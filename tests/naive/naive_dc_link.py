"""Slow oracle of the DC link: the circuit's ODE in voltage, integrated between located events."""

import itertools

import numpy as np
from scipy.integrate import solve_ivp

from sequencing.timing.power.dc_link import LinkParams, LinkRun


def circuit_energies(power_w, total_s, breaks, link: LinkParams, hysteresis: bool) -> dict:
    """Grid, chopper and end energy [J] for a power profile power_w(t) smooth between `breaks`.

    The state is the voltage; modes are rectifier (V held at supply while P > 0), free, and
    chopper (ideal: V held at the threshold while P < 0; hysteresis: resistor on).
    """
    c, v_low, v_on = link.capacitance_f, link.voltage_v, link.chopper_v
    v_off = link.chopper_off_v
    edges = sorted({0.0, total_s, *[b for b in breaks if 0 < b < total_s]})
    v, mode, t = v_low, "free", 0.0
    grid = burnt = 0.0
    for left, right in itertools.pairwise(edges):
        t = left
        eps = 1e-12 * (1 + total_s)
        guard = 0
        while t < right - eps:
            guard += 1
            assert guard < 10_000
            p_now = power_w(min(t + 1e-9, 0.5 * (t + right)))
            if mode == "free" and v <= v_low * (1 + 1e-12) and p_now > 0:
                mode = "rectifier"
            if mode == "free" and not hysteresis and v >= v_on * (1 - 1e-12) and p_now < 0:
                mode = "clamp"
            if mode == "free" and hysteresis and v >= v_on * (1 - 1e-12) and p_now < 0:
                mode = "burn"

            def rhs(time, y, mode=mode):
                p = power_w(time)
                if mode == "rectifier":
                    return [0.0, p, 0.0]
                if mode == "clamp":
                    return [0.0, 0.0, -p]
                if mode == "burn":
                    return [
                        -p / (c * y[0]) - y[0] / (link.chopper_ohm * c),
                        0.0,
                        y[0] ** 2 / link.chopper_ohm,
                    ]
                return [-p / (c * y[0]), 0.0, 0.0]

            events = {
                "rectifier": [lambda time, y: power_w(time)],
                "clamp": [lambda time, y: power_w(time)],
                "burn": [lambda time, y: y[0] - v_off],
                "free": [lambda time, y: y[0] - v_low, lambda time, y: y[0] - v_on],
            }[mode]
            directions = {"rectifier": [-1], "clamp": [1], "burn": [-1], "free": [-1, 1]}[mode]
            for event, direction in zip(events, directions):
                event.terminal = True
                event.direction = direction
            run = solve_ivp(
                rhs, (t, right), [v, 0.0, 0.0], events=events, rtol=1e-9, atol=1e-9, max_step=0.02
            )
            v = run.y[0, -1]
            grid += run.y[1, -1]
            burnt += run.y[2, -1]
            t = run.t[-1]
            if run.status == 1:
                if mode == "free":
                    low = len(run.t_events[0]) > 0
                    v = v_low if low else v_on
                    mode = "rectifier" if low else ("burn" if hysteresis else "clamp")
                else:
                    mode = "free"
    start, end = 0.5 * c * v_low**2, 0.5 * c * v**2
    return {
        "grid_j": grid,
        "chopper_j": burnt,
        "energy_j": link.grid_factor * (grid - (end - start)),
        "end_j": end,
    }


def simulate_clip(drawn, link: LinkParams) -> LinkRun:
    """The clip model over the energies drawn per step, one Python step at a time."""
    low, high = link.min_energy_j, link.max_energy_j
    w, grid, chopper, stored = low, [], [], [low]
    for e in np.asarray(drawn, dtype=float):
        y = w - e
        grid.append(max(0.0, low - y))
        chopper.append(max(0.0, y - high))
        w = min(max(y, low), high)
        stored.append(w)
    energy_j = link.grid_factor * (sum(grid) - (w - low))
    return LinkRun(np.array(grid), np.array(chopper), np.array(stored), energy_j)
