"""Identification on simulated logs, where the truth is known."""

from __future__ import annotations

import shutil
from dataclasses import replace
from pathlib import Path

import numpy as np
import pinocchio as pin
import pytest
import trimesh

from dmoc.arrays import Array
from dmoc.errors import InputError, RobotError
from dmoc.identification.consistent import (
    Compressed,
    fit_consistent,
    friction_first,
    link_numbers,
    pseudo_inertia,
    weighted_least_squares,
)
from dmoc.identification.identifying import Identification, IdentificationProblem, identify
from dmoc.identification.samples import MotionLog, Samples, samples_of
from dmoc.identification.terms import GasSpring, TermColumns, couplings_of
from dmoc.identification.written import predicted_torque_nm, read_identified, write_identification
from dmoc.robot.robot import Robot, load_robot

COULOMB = np.array([12.0, 14.0, 9.0, 3.0, 2.5, 2.0])
VISCOUS = np.array([15.0, 18.0, 11.0, 3.0, 2.5, 2.0])
NOISE = np.array([2.0, 2.0, 1.0, 0.4, 0.4, 0.3])


def motion(seed: int, seconds: float = 20.0, rate_hz: float = 250.0) -> tuple[Array, ...]:
    """Times and a Fourier motion of six joints with its derivatives."""
    rng = np.random.default_rng(seed)
    t = np.arange(0.0, seconds, 1.0 / rate_hz)
    q, qd, qdd = np.zeros((3, len(t), 6))
    for k in range(1, 6):
        w = 2 * np.pi * k / 10.0
        for j in range(6):
            a, b = rng.uniform(-0.35, 0.35, 2)
            q[:, j] += a * np.sin(w * t) + b * np.cos(w * t)
            qd[:, j] += w * (a * np.cos(w * t) - b * np.sin(w * t))
            qdd[:, j] -= w * w * (a * np.sin(w * t) + b * np.cos(w * t))
    return t, q + np.array([0.0, -1.2, 1.2, -0.8, 0.6, 0.0]), qd, qdd


def truth(robot: Robot, layout: TermColumns) -> Array:
    """Bodies ten to thirty per cent off the robot file, rotors as in it, friction of a real arm."""
    out = np.zeros(layout.size)
    for i in range(6):
        body = pin.Inertia(robot.model.inertias[i + 1])
        scale = 1.0 + 0.1 * (1 + i % 3)
        body.mass, body.inertia = scale * body.mass, scale * body.inertia
        out[10 * i : 10 * i + 10] = body.toDynamicParameters()
    out[layout.block("armature")] = 1.1 * robot.armature_kg_m2
    out[layout.block("coulomb")], out[layout.block("viscous")] = COULOMB, VISCOUS
    out[layout.block("offset")] = [1.0, -1.0, 0.5, 0.2, -0.2, 0.1]
    out[layout.block("coupling")] = [0.05, 0.5, 0.4][: 3 * len(layout.couplings)]
    out[layout.block("springs")] = 0.9
    return out


def simulated(robot: Robot, layout: TermColumns, seed: int, seconds: float = 20.0) -> Samples:
    """Samples without noise, 20 ms apart."""
    _, q, qd, qdd = motion(seed, seconds, 50.0)
    blank = Samples("simulated", 0.02, q, qd, qdd, np.zeros_like(q))
    torque = layout.regressor(blank) @ truth(robot, layout)
    return replace(blank, torque_nm=torque)


def noisy_log(robot: Robot, layout: TermColumns, seed: int) -> MotionLog:
    """A log at 250 Hz whose torque has white noise."""
    t, q, qd, qdd = motion(seed)
    blank = Samples("log", 0.004, q, qd, qdd, np.zeros_like(q))
    torque = layout.regressor(blank) @ truth(robot, layout)
    noise = np.random.default_rng(seed + 100).standard_normal(q.shape) * NOISE
    return MotionLog(f"log_{seed}", t, q, torque + noise)


@pytest.fixture(scope="module")
def robot() -> Robot:
    return load_robot("ur10e_class")


@pytest.fixture(scope="module")
def identified(robot: Robot) -> Identification:
    layout = TermColumns(robot.model, np.zeros((0, 6)))
    logs = tuple(noisy_log(robot, layout, seed) for seed in (1, 2))
    return identify(IdentificationProblem(robot, logs[:1], logs[1:]))


def test_base_parameters_come_back_from_exact_samples(robot: Robot) -> None:
    ratio = np.eye(6)
    ratio[5, 4] = 1.0
    spring = GasSpring(1, (0.8, 0.2), -1.6, 1e-4, 1e-3, 1e4)
    layout = TermColumns(robot.model, couplings_of(ratio), (spring,))
    run = simulated(robot, layout, 0)
    regressor = layout.regressor(run)
    data = Compressed.of(regressor, run.torque_nm, run.moving)
    _, sigma = weighted_least_squares(data)
    prior = IdentificationProblem(
        robot, (MotionLog("", np.zeros(1), run.q_rad, run.q_rad),), (), (spring,), ratio
    ).prior
    start = friction_first(data, sigma, layout, prior)
    fit = fit_consistent(data, sigma, layout, prior, start, 10.0, np.ones(6))
    # The base parameters are the coordinates of the row space: what the torques can see.
    flat = regressor.reshape(-1, layout.size)
    scale = np.linalg.norm(flat, axis=0) + 1e-12
    _, s, vt = np.linalg.svd(flat / scale, full_matrices=False)
    seen = vt[s > 1e-8 * s[0]]
    expected = seen @ (truth(robot, layout) * scale)
    found = seen @ (fit.parameters * scale)
    assert len(seen) > 50
    assert np.abs(found - expected).max() <= 1e-6 * np.abs(expected).max()
    for i in range(6):
        body = pseudo_inertia(fit.parameters[10 * i : 10 * i + 10])
        assert np.linalg.eigvalsh(body)[0] > 0


@pytest.mark.parametrize(
    "seeds",
    [
        pytest.param(range(10, 14), id="four"),
        pytest.param(range(10, 34), marks=pytest.mark.slow, id="twenty-four"),
    ],
)
def test_two_sigma_cover_the_truth(robot: Robot, seeds: range) -> None:
    """Through the whole chain: 250 Hz, white noise, filter, thinning, fit."""
    layout = TermColumns(robot.model, np.zeros((0, 6)))
    true, off = truth(robot, layout), []
    for seed in seeds:
        fit = identify(IdentificationProblem(robot, (noisy_log(robot, layout, seed),)))
        for block in ("armature", "coulomb", "viscous", "offset"):
            part = layout.block(block)
            off.append((fit.parameters[part] - true[part]) / fit.std[part])
    sigmas = np.concatenate(off)
    assert 0.90 <= np.mean(np.abs(sigmas) <= 2.0) <= (0.98 if len(seeds) > 20 else 1.0)
    assert 0.8 <= np.sqrt(np.mean(sigmas**2)) <= 1.2, "neither too narrow nor too wide"


def test_a_sliding_joint_is_refused(tmp_path: Path) -> None:
    text = load_robot("ur10e_class").urdf.read_text()
    first = text.index('type="revolute"')
    (tmp_path / "track.urdf").write_text(text[:first] + 'type="prismatic"' + text[first + 15 :])
    t, q, _, _ = motion(0, 2.0)
    with pytest.raises(RobotError, match="identification-slides"):
        IdentificationProblem(load_robot(tmp_path / "track.urdf"), (MotionLog("a", t, q, q),))


def test_a_written_pair_keeps_its_meshes(identified: Identification, tmp_path: Path) -> None:
    source = tmp_path / "arm_description" / "urdf"
    (source.parent / "meshes").mkdir(parents=True)
    (source / "own").mkdir(parents=True)
    (source.parent / "package.xml").write_text("<package><name>arm_description</name></package>")
    text = identified.problem.robot.urdf.read_text()
    solid = trimesh.creation.box((0.1, 0.1, 0.1)).export(file_type="stl")
    names = ("own/a.stl", "../meshes/a.stl", "package://arm_description/meshes/b.stl")
    for k, name in enumerate(names):
        path = source.parent / "meshes" / "b.stl" if "://" in name else source / name
        path.write_bytes(solid + bytes(k))
        shape = f'<visual><geometry><mesh filename="{name}"/></geometry></visual>'
        text = text.replace("</link>", shape + "</link >", 1)
    (source / "robot.urdf").write_text(text.replace("</link >", "</link>"))
    shutil.copy(identified.problem.robot.urdf.with_name("robot.yaml"), source)
    moved = replace(identified.problem, robot=load_robot(source / "robot.urdf"))
    for _ in range(2):  # again into the same folder: no second copies
        write_identification(replace(identified, problem=moved), tmp_path / "new")
    shutil.rmtree(source.parent)
    robot = load_robot(tmp_path / "new" / "robot.urdf")
    links = robot.description.links.values()
    found = [shape.mesh for link in links for shape in link.visual if shape.mesh]
    assert sorted(len(path.read_bytes()) - len(solid) for path in found) == [0, 1, 2]
    assert len(list((tmp_path / "new").rglob("*.stl"))) == 3


def test_held_out_runs_are_predicted_and_the_pair_says_the_same(
    identified: Identification, tmp_path: Path
) -> None:
    assert identified.status == "identified"
    assert identified.held_out
    (score,) = identified.scores
    assert score.mean_percent < 6.0
    assert abs(score.energy_percent) < 1.0
    write_identification(identified, tmp_path)
    run = samples_of(identified.problem.held[0])
    ours = identified.torque_nm(run)
    again = predicted_torque_nm(tmp_path / "robot.urdf", run)
    assert np.abs(ours - again).max() <= 1e-9 * np.abs(ours).max()
    written, _, _ = read_identified(tmp_path / "robot.urdf")
    assert written.provenance["coulomb_nm"] == "measured"


def test_only_inertials_change_in_the_urdf(identified: Identification, tmp_path: Path) -> None:
    import re

    write_identification(identified, tmp_path)
    before = identified.problem.robot.urdf.read_text()
    after = (tmp_path / "robot.urdf").read_text()

    def bare(text: str) -> str:
        return re.sub(r"<inertial>.*?</inertial>|\s+", "", text, flags=re.S)

    assert bare(before) == bare(after)


TURNED = np.array([1.0, 1.0, -1.0, 1.0, 1.0, 1.0])


@pytest.mark.parametrize(
    ("change", "code"),
    [
        (lambda q, tau: (q, tau * TURNED), "identify-sign"),
        pytest.param(
            lambda q, tau: (q, tau * np.roll(TURNED, -2)), "identify-sign", marks=pytest.mark.slow
        ),
        pytest.param(
            lambda q, tau: (q * TURNED, tau * TURNED), "identify-axis", marks=pytest.mark.slow
        ),
        pytest.param(
            lambda q, tau: (q - [0, -np.pi / 2, np.pi / 2, 0, 0, 0], tau),
            "identify-home",
            marks=pytest.mark.slow,
        ),
        (lambda q, tau: (q, np.vstack([tau[:1].repeat(10, 0), tau[:-10]])), "identify-delay"),
    ],
    ids=["sign-3", "sign-1", "axis-3", "home", "late"],
)
def test_mistakes_are_named(robot: Robot, change: object, code: str, tmp_path: Path) -> None:
    layout = TermColumns(robot.model, np.zeros((0, 6)))
    log = noisy_log(robot, layout, 3)
    q, tau = change(log.q_rad, log.torque_nm)  # type: ignore[operator]
    fit = identify(IdentificationProblem(robot, (replace(log, q_rad=q, torque_nm=tau),)))
    assert fit.status == "faulty"
    assert code in [fault.code for fault in fit.faults]
    with pytest.raises(InputError):
        write_identification(fit, tmp_path)


@pytest.mark.slow
def test_reversed_gravity_is_named(robot: Robot) -> None:
    layout = TermColumns(robot.model, np.zeros((0, 6)))
    log = noisy_log(robot, layout, 3)
    hung = replace(robot, model=pin.Model(robot.model))
    hung.model.gravity.linear = -hung.model.gravity.linear
    fit = identify(IdentificationProblem(hung, (log,)))
    assert [fault.code for fault in fit.faults] == ["identify-gravity"]


def test_what_free_motion_cannot_tell_is_said(identified: Identification) -> None:
    text = " ".join(identified.unidentifiable)
    assert "constant factor" in text
    assert "joint's zero" in text


def test_a_joint_at_rest_keeps_its_tag(robot: Robot) -> None:
    layout = TermColumns(robot.model, np.zeros((0, 6)))
    log = noisy_log(robot, layout, 4)
    q = log.q_rad.copy()
    q[:, 1:] = q[0, 1:]
    fit = identify(IdentificationProblem(robot, (replace(log, q_rad=q),)))
    assert fit.status == "poor"
    assert {f.field for f in fit.warnings if f.code == "identify-still"} == set(
        list(robot.model.names)[2:]
    )
    assert not fit.measured.any()


def test_a_short_log_is_refused(robot: Robot) -> None:
    t, q, _, _ = motion(0, 0.8)
    with pytest.raises(InputError, match="log-short"):
        identify(IdentificationProblem(robot, (MotionLog("short", t, q, q),)))


def test_link_numbers_invert_the_pseudo_inertia() -> None:
    body = pin.Inertia.Random()
    pi = np.asarray(body.toDynamicParameters())
    np.testing.assert_allclose(link_numbers(pseudo_inertia(pi)), pi, atol=1e-14)
