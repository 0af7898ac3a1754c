"""Identification of two real robots against the goals: `python -m benchmarks.identification`.

The KUKA KR 300 is built here from the constants that its log's authors published (DH, masses,
gears, rotors, gas spring); the TX40 from its published URDF with solid spheres for inertias, since
its own are no bodies. Both logs are read in place.
"""

from __future__ import annotations

import re
import time
from pathlib import Path

import numpy as np
import pinocchio as pin

from dmoc.identification.identifying import Identification, IdentificationProblem, identify
from dmoc.identification.samples import MotionLog
from dmoc.identification.terms import GasSpring
from dmoc.robot.robot import Robot, load_robot

# d, a [m], alpha, offset [°] of the standard Denavit-Hartenberg frames; the base is turned about x.
_DH = (
    (-0.675, 0.350, 90, 0),
    (-0.189, 1.150, 0, 0),
    (0.189, 0.041, -90, 90),
    (-1.000, 0.0, 90, 0),
    (0.0, 0.0, -90, 0),
    (-0.240, 0.0, 180, 0),
)
GEARS = np.array([1798 / 7, 1872 / 7, 757 / 3, 221, 5032 / 21, 206793 / 1340])
_ROTOR = np.array([0.00923, 0.0118, 0.0118, 0.00173, 0.00173, 0.00173])
_MASS = (395.40, 339.12, 105.21, 35.80, 31.46, 17.78)
_COM_MM = (
    (-353, 174, -4),
    (-709, -1, 23),
    (-18, -18, -76),
    (0, 236, 1),
    (0, -80, -9),
    (0, 0, -50),
)
_INERTIA = (  # xx yy zz xy yz xz about the centre of mass
    (16.733765, 29.799119, 32.814954, -1.703664, 0.129384, 4.404062),
    (7.507819, 88.886691, 88.673761, 0.430046, 0.173157, -4.396607),
    (10.783798, 10.186135, 1.943179, 0.118474, -0.606384, -0.101950),
    (0.425035, 0.217993, 0.428465, 0.0, -0.011353, 0.0),
    (0.283826, 0.229562, 0.258266, 0.0, -0.019521, -0.000120),
    (0.1, 0.1, 0.1, 0.0, 0.0, 0.0),
)
_GUESS_KG = (400.0, 300.0, 150.0, 60.0, 40.0, 150.0)
KR300_SPRING = GasSpring(
    joint=1,
    anchors_m=(0.8, 0.2),
    zero_rad=float(np.radians(-95.0)),
    area_m2=float(np.pi / 4 * (0.055**2 - 0.030**2)),
    volume_m3=2 * 0.48e-3,
    gas_j=1.01 * 296.8 * 328 * 2 * 0.0795,
)


def _rotation(axis: str, angle: float) -> pin.SE3:
    turn = {"x": (angle, 0, 0), "z": (0, 0, angle)}[axis]
    return pin.SE3(pin.rpy.rpyToMatrix(*turn), np.zeros(3))


def kr300_bodies() -> tuple[list[pin.SE3], list[pin.Inertia]]:
    """Where the next joint stands in every joint's frame, and the link's inertia there."""
    places, bodies = [], []
    for k, (d, a, alpha, offset) in enumerate(_DH):
        place = _rotation("z", np.radians(offset)) * pin.SE3(np.eye(3), np.array([a, 0.0, d]))
        place = place * _rotation("x", np.radians(alpha))
        xx, yy, zz, xy, yz, xz = _INERTIA[k]
        tensor = np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])
        body = pin.Inertia(_MASS[k], np.array(_COM_MM[k]) / 1e3, tensor)
        if k == 5:
            body = body + pin.Inertia(150.0, np.array([0.0, 0.0, 0.1]), np.zeros((3, 3)))
        places.append(place)
        bodies.append(place.act(body))
    return places, bodies


def spheres(places: list[pin.SE3]) -> list[pin.Inertia]:
    """Guessed masses half way to the next joint, as solid spheres of 2000 kg/m³."""
    out = []
    for mass, place in zip(_GUESS_KG, places):
        radius = (mass / 2000.0 * 3 / (4 * np.pi)) ** (1 / 3)
        moment = 0.4 * mass * radius**2 * np.eye(3)
        out.append(pin.Inertia(mass, place.translation / 2, moment))
    return out


def write_kr300(folder: Path, bodies: list[pin.Inertia], places: list[pin.SE3]) -> Path:
    """URDF and robot.yaml of the KR 300 with these bodies."""

    def origin(pose: pin.SE3) -> str:
        rpy = pin.rpy.matrixToRpy(pose.rotation)
        xyz = " ".join(repr(float(v)) for v in pose.translation)
        return f'<origin xyz="{xyz}" rpy="{" ".join(repr(float(v)) for v in rpy)}"/>'

    rows = ['<robot name="kr300">', '<link name="base"/>']
    here = _rotation("x", np.pi)
    for k, (body, place) in enumerate(zip(bodies, places), start=1):
        t = body.inertia
        tensor = f'ixx="{t[0, 0]!r}" ixy="{t[0, 1]!r}" ixz="{t[0, 2]!r}" iyy="{t[1, 1]!r}" '
        tensor += f'iyz="{t[1, 2]!r}" izz="{t[2, 2]!r}"'
        mass = f'<mass value="{body.mass!r}"/><inertia {tensor}/>'.replace("np.float64(", "")
        com = origin(pin.SE3(np.eye(3), body.lever))
        above = f"link_{k - 1}" if k > 1 else "base"
        rows += [
            f'<link name="link_{k}"><inertial>{com}{mass.replace(")", "")}</inertial></link>',
            f'<joint name="joint_{k}" type="revolute"><parent link="{above}"/>'
            f'<child link="link_{k}"/>{origin(here)}<axis xyz="0 0 1"/>'
            '<limit lower="-6.2" upper="6.2" velocity="2.0" effort="9000"/></joint>',
        ]
        here = place
    rows += [
        '<link name="flange"/><joint name="to_flange" type="fixed"><parent link="link_6"/>'
        f'<child link="flange"/>{origin(here)}</joint></robot>'
    ]
    folder.mkdir(parents=True, exist_ok=True)
    (folder / "kr300.urdf").write_text("\n".join(rows))
    armature = ", ".join(repr(float(v)) for v in GEARS**2 * _ROTOR)
    gears = ", ".join(repr(float(v)) for v in GEARS)
    s = KR300_SPRING
    (folder / "robot.yaml").write_text(
        f"name: kr300\nflange: flange\narmature_kg_m2: [{armature}]\n"
        f"drive: {{class: heavy, gear_ratio: [{gears}]}}\n"
        f"springs:\n  - {{joint: joint_2, kind: gas, anchors_m: [0.8, 0.2], "
        f"zero_rad: {s.zero_rad!r}, area_m2: {s.area_m2!r}, volume_m3: {s.volume_m3!r}, "
        f"gas_j: {s.gas_j!r}, scale: 1.0}}\n"
    )
    return folder / "kr300.urdf"


def kr300_log(path: Path) -> MotionLog:
    """A run of the KR 300: joint torque = gear ratio x motor torque."""
    data = np.genfromtxt(path, delimiter=",", names=True)
    q = np.column_stack([data[f"actual_q_{j}"] for j in range(6)])
    tau = np.column_stack([data[f"motor_torque_{j}"] for j in range(6)]) * GEARS
    return MotionLog(path.stem, data["timestamp"], q, tau)


TX40_FROM_JOINT = np.diag([32.0, 32.0, 45.0, -48.0, 45.0, 32.0])
TX40_FROM_JOINT[5, 4] = 32.0


def tx40(folder: Path, data: Path) -> tuple[Robot, MotionLog]:
    """The TX40 with solid spheres of its masses, and its log in joint coordinates."""
    text = (data / "tx40_mdh_modified.urdf").read_text()

    def sphere(found: re.Match[str]) -> str:
        mass = float(found.group(2))
        moment = 0.4 * mass * (mass / 2700.0 * 3 / (4 * np.pi)) ** (2 / 3)
        tensor = f'ixx="{moment}" ixy="0" ixz="0" iyy="{moment}" iyz="0" izz="{moment}"'
        return f"{found.group(1)}<inertia {tensor}/>"

    text = re.sub(r'(<mass value="([0-9.]+)"/>.*?)<inertia [^>]*/>', sphere, text, flags=re.S)
    text = re.sub(r"<(visual|collision)>.*?</\1>", "", text, flags=re.S)
    folder.mkdir(parents=True, exist_ok=True)
    (folder / "tx40.urdf").write_text(text)
    table = np.genfromtxt(data / "run.csv", delimiter=",", names=True)
    motor = np.column_stack([table[f"motor_q_{j}"] for j in range(6)])
    torque = np.column_stack([table[f"motor_torque_{j}"] for j in range(6)])
    zero = np.array([0.0, -np.pi / 2, np.pi / 2, 0.0, 0.0, 0.0])
    q = np.linalg.solve(TX40_FROM_JOINT, motor.T).T + zero
    log = MotionLog("tx40", table["timestamp"], q, torque @ TX40_FROM_JOINT)
    return load_robot(folder / "tx40.urdf"), log


def _row(test: str, goal: str, got: str) -> None:
    print(f"| {test} | {goal} | {got} |", flush=True)


def _figures(fit: Identification) -> tuple[float, float, float]:
    scores = fit.scores
    worst = max(max(s.rel_percent) for s in scores)
    energy = max(abs(s.energy_percent) for s in scores)
    return float(np.mean([s.mean_percent for s in scores])), worst, energy


def _part(log: MotionLog, start_s: float, end_s: float) -> MotionLog:
    keep = (log.t_s >= start_s) & (log.t_s < end_s)
    name = f"{log.name} {start_s}-{end_s} s"
    return MotionLog(name, log.t_s[keep], log.q_rad[keep], log.torque_nm[keep])


def kr300_faults(log: MotionLog) -> dict[str, MotionLog]:
    """The log with each of the eight mistakes put in."""
    q, tau = log.q_rad, log.torque_nm
    turned = np.array([1.0, 1.0, -1.0, 1.0, 1.0, 1.0])
    first = np.array([-1.0, 1.0, 1.0, 1.0, 1.0, 1.0])
    home = np.array([0.0, -np.pi / 2, np.pi / 2, 0.0, 0.0, 0.0])
    gear = np.array([1.0, 1.2, 1.0, 1.0, 1.0, 1.0])
    bent = np.array([0.0, np.radians(3.0), 0.0, 0.0, 0.0, 0.0])
    made = {
        "home offset forgotten": (q - home, tau),
        "axis 3 reversed": (q * turned, tau * turned),
        "sign of torque 3": (q, tau * turned),
        "sign of torque 1": (q, tau * first),
        "gear ratio of axis 2 x 1.2": (q, tau * gear),
        "joint 2 off by 3°": (q + bent, tau),
        "gravity reversed": (q, tau),
        "torque 40 ms late": (q, np.vstack([np.repeat(tau[:1], 10, 0), tau[:-10]])),
    }
    return {k: MotionLog(f"{log.name}: {k}", log.t_s, a, b) for k, (a, b) in made.items()}


def main(data: Path, work: Path) -> None:
    """Print the table of goals; `data` holds kr300/ and tx40/, `work` takes the robots' files."""
    print("| test | goal | measured |\n|---|---|---|")
    places, bodies = kr300_bodies()
    robot = load_robot(write_kr300(work / "kr300", bodies, places))
    a, b = (kr300_log(data / "kr300" / f"{name}.csv") for name in "AB")
    springs = (KR300_SPRING,)
    held = data / "kr300" / "C.csv"
    pairs = [((a,), (b,)), ((b,), (a,))]
    if held.is_file():
        c = kr300_log(held)
        pairs = [((a, b), (c,)), ((a, c), (b,)), ((b, c), (a,))]
    rng = np.random.default_rng(0)
    wrong = [pin.Inertia(body) for body in bodies]
    for body, factor in zip(wrong, rng.uniform(0.6, 1.4, 6)):
        body.inertia, body.mass = body.inertia * factor, body.mass * factor
    guesses = {"maker's bodies": bodies, "prior ± 40 %": wrong, "guessed spheres": spheres(places)}
    for k, (name, guess) in enumerate(guesses.items()):
        model = load_robot(write_kr300(work / f"kr300_{k}", guess, places))
        for train, test in pairs:
            fit = identify(IdentificationProblem(model, train, test, springs))
            mean, worst, energy = _figures(fit)
            score = fit.scores[0]
            what = f"KR 300 {'+'.join(log.name for log in train)} → {score.name}, {name}"
            got = f"{mean:.1f} / {worst:.1f} %, E+ {score.energy_percent:+.1f} % (assumed class "
            _row(what, "≤ 11 / 18 %, 3 %", got + f"{score.assumed_energy_percent:+.0f} %)")
    start = time.process_time()
    fit = identify(IdentificationProblem(robot, (a, b), (), springs))
    _row("20 s at 250 Hz, CPU", "≤ 3 s", f"{time.process_time() - start:.1f} s, {fit.status}")
    scale = float(fit.named("springs")[0])
    _row("spring scale from A+B", "0.9–1.1", f"{scale:.3f}")
    arm, log = tx40(work / "tx40", data / "tx40")
    end = float(log.t_s[-1])
    cut = 4.6 if end > 5 else 3.4
    parts = ((_part(log, 0.0, cut),), (_part(log, cut, min(end, 7.4)),))
    problem = IdentificationProblem(arm, *parts, motor_from_joint=TX40_FROM_JOINT, cutoff_hz=20.0)
    mean, worst, energy = _figures(identify(problem))
    _row(f"TX40, t < {cut} s → the rest", "≤ 15.5 %, 5 %", f"{mean:.1f} %, E+ {energy:.1f} %")
    for name in kr300_faults(a):
        logs = tuple(kr300_faults(log)[name] for log in (a, b))
        model = robot
        if name == "gravity reversed":
            upside = load_robot(write_kr300(work / "kr300", bodies, places))
            upside.model.gravity.linear = -upside.model.gravity.linear
            model = upside
        fit = identify(IdentificationProblem(model, logs, (), springs))
        found = "; ".join(f"{f.code} {f.field}" for f in fit.faults) or "; ".join(
            f"{f.code} {f.field}" for f in fit.warnings
        )
        _row(f"fault: {name}", "named, or not identifiable", f"{fit.status}: {found}")


if __name__ == "__main__":
    import sys
    import tempfile

    main(Path(sys.argv[1]), Path(tempfile.mkdtemp()))
