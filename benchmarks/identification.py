"""Identification of two real robots against the goals: `python -m benchmarks.identification`.

The KUKA KR 300 is built here from the constants that its log's authors published (DH, masses,
gears, rotors, gas spring); the TX40 from its published URDF with solid spheres for inertias, since
its own are no bodies. Both logs are read in place.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pinocchio as pin

from dmoc.identification.samples import MotionLog
from dmoc.identification.terms import GasSpring

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
        rows += [
            f'<link name="link_{k}"><inertial>{com}{mass.replace(")", "")}</inertial></link>',
            f'<joint name="joint_{k}" type="revolute"><parent link="{f"link_{k - 1}" if k > 1 else "base"}"/>'
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
        f"springs:\n  - {{joint: joint_2, kind: gas, anchors_m: [0.8, 0.2], zero_rad: {s.zero_rad!r}, "
        f"area_m2: {s.area_m2!r}, volume_m3: {s.volume_m3!r}, gas_j: {s.gas_j!r}, scale: 1.0}}\n"
    )
    return folder / "kr300.urdf"


def kr300_log(path: Path) -> MotionLog:
    """A run of the KR 300: joint torque = gear ratio x motor torque."""
    data = np.genfromtxt(path, delimiter=",", names=True)
    q = np.column_stack([data[f"actual_q_{j}"] for j in range(6)])
    tau = np.column_stack([data[f"motor_torque_{j}"] for j in range(6)]) * GEARS
    return MotionLog(path.stem, data["timestamp"], q, tau)
