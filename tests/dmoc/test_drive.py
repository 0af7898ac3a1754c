"""Drive model: energy flow, smooth variant, CasADi against numpy, input faults."""

import casadi as ca
import numpy as np
import pytest

from dmoc.errors import RobotError
from dmoc.robot.drive import (
    DriveParams,
    array_fields,
    drive_from_mapping,
    electrical_power_w,
    heavy_class_drive,
    ur_class_drive,
)

RNG = np.random.default_rng(5)


def lossless(n: int = 3) -> DriveParams:
    zero = {name: np.zeros(n) for name in array_fields()}
    return DriveParams(
        **{**zero, "gear_ratio": np.full(n, 100.0), "torque_constant_nm_a": np.full(n, 0.1)}
    )


@pytest.mark.parametrize("params", [ur_class_drive(), heavy_class_drive()])
@pytest.mark.parametrize("smoothing", [0.0, 0.01])
def test_casadi_and_numpy_agree(params: DriveParams, smoothing: float) -> None:
    qd, qdd, tau = (ca.SX.sym(name, 6) for name in ("qd", "qdd", "tau"))
    power = ca.Function("p", [qd, qdd, tau], [electrical_power_w(qd, qdd, tau, params, smoothing)])
    for _ in range(20):
        a, b, c = RNG.normal(size=6), RNG.normal(size=6), 50 * RNG.normal(size=6)
        expected = electrical_power_w(a, b, c, params, smoothing)
        np.testing.assert_allclose(np.array(power(a, b, c)).ravel(), expected, rtol=1e-12)


def test_lossless_axis_draws_mechanical_power() -> None:
    qd, tau = RNG.normal(size=(7, 3)), RNG.normal(size=(7, 3))
    np.testing.assert_allclose(electrical_power_w(qd, 0 * qd, tau, lossless()), qd * tau)


@pytest.mark.parametrize("params", [ur_class_drive(), heavy_class_drive()])
def test_losses_are_never_negative(params: DriveParams) -> None:
    qd, tau = RNG.normal(size=(200, 6)), 100 * RNG.normal(size=(200, 6))
    assert (electrical_power_w(qd, 0 * qd, tau, params) - qd * tau >= 0).all()


def test_naive_scalar_loop_agrees() -> None:
    p = heavy_class_drive()
    qd, qdd, tau = RNG.normal(size=6), RNG.normal(size=6), 200 * RNG.normal(size=6)
    for j in range(6):
        sgn = float(np.sign(qd[j]))
        gear = tau[j] + p.coulomb_nm[j] * sgn + p.viscous_nm_s[j] * qd[j]
        motor_torque = gear / p.gear_ratio[j]
        current = motor_torque / p.torque_constant_nm_a[j]
        omega = p.gear_ratio[j] * qd[j]
        expected = motor_torque * omega + p.copper_ohm[j] * current**2
        expected += p.eddy_w_s2[j] * omega**2 + p.hysteresis_w_s[j] * abs(omega)
        expected += p.inverter_v[j] * abs(current) + p.inverter_ohm[j] * current**2 + p.idle_w[j]
        assert electrical_power_w(qd, qdd, tau, p)[j] == pytest.approx(expected, rel=1e-12)


def test_smooth_variant_has_finite_derivatives_at_rest() -> None:
    params = ur_class_drive()
    x = ca.SX.sym("x", 18)
    power = ca.sum1(electrical_power_w(x[:6], x[6:12], x[12:], params, 0.02))
    hessian, gradient = ca.hessian(power, x)
    values = ca.Function("d", [x], [hessian, gradient])(np.zeros(18))
    assert all(np.isfinite(np.array(v)).all() for v in values)


def test_smooth_variant_converges_to_the_exact_one() -> None:
    params, qd, tau = ur_class_drive(), RNG.normal(size=(50, 6)), 30 * RNG.normal(size=(50, 6))
    exact = electrical_power_w(qd, 0 * qd, tau, params).sum()
    gaps = [
        abs(electrical_power_w(qd, 0 * qd, tau, params, eps).sum() - exact)
        for eps in (0.1, 0.01, 0.001)
    ]
    assert gaps[2] < gaps[1] < gaps[0]
    assert gaps[2] < 1e-2 * abs(exact)


def test_every_parameter_of_the_classes_is_tagged() -> None:
    for params in (ur_class_drive(), heavy_class_drive()):
        assert set(array_fields()) <= set(params.provenance)


def test_mapping_reports_all_faults_at_once() -> None:
    with pytest.raises(RobotError) as caught:
        drive_from_mapping({"gear": 3, "class": "tank"}, 6)
    assert {fault.field for fault in caught.value.faults} == {"drive.gear", "drive.class"}
    with pytest.raises(RobotError) as caught:
        drive_from_mapping({"gear_ratio": 100}, 6)
    assert len(caught.value.faults) == 2


def test_mapping_overrides_a_class() -> None:
    params = drive_from_mapping(
        {"class": "ur", "coulomb_nm": [1, 2, 3, 4, 5, 6]}, 6, {"coulomb_nm": "measured"}
    )
    assert params.coulomb_nm[5] == 6
    assert params.tag("coulomb_nm") == "measured"
    assert params.base_power_w == ur_class_drive().base_power_w


@pytest.mark.parametrize("value", [-1.0, np.nan, np.inf])
def test_illegal_values_are_refused(value: float) -> None:
    with pytest.raises(RobotError, match="copper_ohm"):
        drive_from_mapping({"class": "heavy", "copper_ohm": value}, 6)


def test_arrays_are_read_only_and_pickle() -> None:
    import pickle

    params = heavy_class_drive()
    with pytest.raises(ValueError):
        params.coulomb_nm[0] = 1.0
    again = pickle.loads(pickle.dumps(params))
    assert again.to_dict() == params.to_dict()


def test_round_off_of_a_joint_at_rest_has_no_friction() -> None:
    params, tau = heavy_class_drive(), 200 * RNG.normal(size=6)
    still = electrical_power_w(np.zeros(6), np.zeros(6), tau, params)
    for noise in (1e-13, -1e-13):
        np.testing.assert_allclose(
            electrical_power_w(np.full(6, noise), np.zeros(6), tau, params), still, atol=1e-6
        )
    qd = ca.SX.sym("qd", 6)
    power = ca.Function("p", [qd], [electrical_power_w(qd, np.zeros(6), ca.DM(tau), params)])
    np.testing.assert_allclose(np.array(power(-1e-13)).ravel(), still, atol=1e-6)
