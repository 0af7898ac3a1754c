"""The DC link: balance, no feedback, chopper, price, and the event-based circuit."""

import sys
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from dmoc.errors import InputError
from sequencing.timing.power.dc_link import LinkParams, price_kernel, simulate_hysteresis

sys.path.insert(0, str(Path(__file__).parents[1] / "naive"))
from naive_dc_link import circuit_energies, simulate_clip

LINK = LinkParams()
SMALL = LinkParams(capacitance_f=2e-4)
DT = 0.004


def wave(amplitude_w: float, bias_w: float, seed: int, seconds: float = 2.0):
    """A smooth power profile with braking in it."""
    rng = np.random.default_rng(seed)
    freq, phase, size = rng.uniform(0.5, 3, 4), rng.uniform(0, 6, 4), rng.uniform(0.3, 1, 4)

    def power(t):
        t = np.asarray(t, dtype=float)
        return bias_w + amplitude_w * sum(
            s * np.sin(2 * np.pi * f * t + p) for s, f, p in zip(size, freq, phase)
        )

    return power, seconds


def drawn_energies(power, seconds: float, dt: float) -> np.ndarray:
    """Exact step energies by 8-point Gauss-Legendre."""
    x, w = np.polynomial.legendre.leggauss(8)
    start = np.arange(0.0, seconds - 0.5 * dt, dt)
    return 0.5 * dt * (w * power(start[:, None] + 0.5 * dt * (1 + x))).sum(axis=1)


def energy_price(drawn: np.ndarray, link: LinkParams) -> tuple[float, np.ndarray]:
    """J of the clip model and its gradient, starting at W_min."""
    price, low = np.empty_like(drawn), link.min_energy_j
    return price_kernel(drawn, low, link.max_energy_j, low, link.grid_factor, price), price


powers = st.lists(st.floats(-30.0, 30.0), min_size=1, max_size=200)


@settings(max_examples=150, deadline=None)
@given(powers, st.sampled_from([LINK, SMALL]), st.booleans())
def test_energy_balance_no_feedback_and_silent_chopper(drawn, link, hysteresis) -> None:
    drawn = np.array(drawn)
    run = simulate_hysteresis(drawn, DT, link) if hysteresis else simulate_clip(drawn, link)
    delta = np.diff(run.stored_j)
    np.testing.assert_allclose(run.grid_j - run.chopper_j - drawn, delta, atol=1e-9 * 1e3)
    assert (run.grid_j >= 0).all()
    assert (run.chopper_j >= -1e-9).all()
    assert (run.stored_j >= link.min_energy_j - 1e-9).all()
    off = 0.5 * link.capacitance_f * (link.chopper_off_v if hysteresis else link.chopper_v) ** 2
    below = (run.stored_j[1:] < off - 1e-9) & (run.stored_j[:-1] < off - 1e-9)
    if not hysteresis:
        assert run.chopper_j[below].sum() == 0


@settings(max_examples=100, deadline=None)
@given(powers, st.sampled_from([LINK, SMALL]), st.integers(0, 10**6))
def test_price_is_the_gradient(drawn, link, seed) -> None:
    # Random digits keep the recursion off its kinks, where no gradient exists.
    drawn = np.array(drawn) + np.random.default_rng(seed).uniform(-0.5, 0.5, len(drawn))
    value, price = energy_price(drawn, link)
    assert value == pytest.approx(simulate_clip(drawn, link).energy_j, abs=1e-9)
    assert set(np.unique(price)) <= {0.0, link.grid_factor}
    k = seed % len(drawn)
    step = 1e-6
    up, down = drawn.copy(), drawn.copy()
    up[k] += step
    down[k] -= step
    numeric = (energy_price(up, link)[0] - energy_price(down, link)[0]) / (2 * step)
    assert numeric == pytest.approx(price[k], abs=1e-4)


@pytest.mark.parametrize("seed", range(4))
@pytest.mark.parametrize("link", [LINK, SMALL])
def test_clip_matches_the_event_based_circuit_within_a_thousandth(seed, link) -> None:
    power, seconds = wave(3000, 500, seed)
    ideal = circuit_energies(power, seconds, [], link, hysteresis=False)
    run = simulate_clip(drawn_energies(power, seconds, DT), link)
    assert run.energy_j == pytest.approx(ideal["energy_j"], rel=1e-3)
    assert run.chopper_j.sum() == pytest.approx(ideal["chopper_j"], rel=1e-2, abs=1.0)


@pytest.mark.parametrize("seed", range(3))
def test_hysteresis_matches_the_event_based_circuit_within_a_thousandth(seed) -> None:
    power, seconds = wave(3000, 500, seed)
    circuit = circuit_energies(power, seconds, [], SMALL, hysteresis=True)
    run = simulate_hysteresis(drawn_energies(power, seconds, 0.001), 0.001, SMALL)
    assert circuit["chopper_j"] > 0
    assert run.energy_j == pytest.approx(circuit["energy_j"], rel=1e-3)


def test_halving_the_step_converges() -> None:
    power, seconds = wave(3000, 500, 1)
    fine = simulate_clip(drawn_energies(power, seconds, 0.00025), SMALL).energy_j
    gaps = [
        abs(simulate_clip(drawn_energies(power, seconds, dt), SMALL).energy_j - fine)
        for dt in (0.016, 0.004, 0.001)
    ]
    assert gaps[2] <= gaps[1] <= gaps[0]
    assert gaps[1] < 1e-3 * fine


def test_energy_left_in_the_capacitor_is_credited() -> None:
    run = simulate_clip(np.array([-10.0]), LINK)
    assert run.grid_j.sum() == 0
    assert run.energy_j == pytest.approx(-10.0 * LINK.grid_factor)
    assert simulate_clip(np.array([-10.0, 10.0]), LINK).energy_j == pytest.approx(0.0, abs=1e-9)


def test_a_common_link_never_needs_more_than_separate_ones() -> None:
    rng = np.random.default_rng(3)
    for _ in range(50):
        a, b = rng.normal(1, 10, 200), rng.normal(1, 10, 200)
        both = LinkParams(capacitance_f=2 * SMALL.capacitance_f)
        apart = simulate_clip(a, SMALL).energy_j + simulate_clip(b, SMALL).energy_j
        assert simulate_clip(a + b, both).energy_j <= apart + 1e-9


def test_illegal_links_are_refused() -> None:
    with pytest.raises(InputError, match="chopper_v"):
        LinkParams(chopper_v=500.0, chopper_off_v=490.0)
    with pytest.raises(InputError, match="capacitance_f"):
        LinkParams(capacitance_f=float("nan"))
