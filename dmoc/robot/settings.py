"""robot.yaml: the settings beside a URDF, and every fault in them."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pinocchio as pin

from dmoc.arrays import Array
from dmoc.errors import DmocError, Fault, RobotError
from dmoc.input_file import FieldPath, YamlTree, field_name, read_yaml
from dmoc.robot.controller import controller_from_mapping
from dmoc.robot.description import Description
from dmoc.robot.drive import drive_from_mapping

#: Vectors of one number per joint (or one for all), and the least legal value.
_VECTORS = {
    "armature_kg_m2": 0.0,
    "torque_limit_nm": 1e-9,
    "acceleration_limit_rad_s2": 1e-9,
    "jerk_limit_rad_s3": 1e-9,
    "velocity_limit_rad_s": 1e-9,
    "q_lower_rad": -50.0,
    "q_upper_rad": -50.0,
    "motor_zero_rad": -50.0,
    "torque_offset_nm": -1e6,
}
_MOST = {"q_lower_rad": 50.0, "q_upper_rad": 50.0, "motor_zero_rad": 50.0, "torque_offset_nm": 1e6}
_KNOWN = {
    *_VECTORS,
    "name",
    "flange",
    "controller",
    "drive",
    "provenance",
    "schema_version",
    "allowed_collisions",
    "locked",
    "inertials",
    "use_visual_shapes",
    "xacro_arguments",
    "springs",
    "motor_from_joint",
    "identified",
}
#: What identify writes into `identified`, by the kind of each entry.
_IDENTIFIED = {"status": str, "logs": list, "coupling": list} | dict.fromkeys(
    ("range", "held_out", "fitted", "std", "measured", "links"), dict
)
#: Numbers of a gas spring, the first four > 0.
_SPRING = ("anchors_m", "area_m2", "volume_m3", "gas_j", "zero_rad", "scale")
_TAGS = "measured | published: SOURCE | assumed"


def read_settings(urdf: Path) -> YamlTree:
    """The tree of robot.yaml beside `urdf` (empty if there is none).

    Errors: `RobotError` for a file that is no YAML mapping.
    """
    path = urdf.with_name("robot.yaml")
    misread = _misread(path)
    if misread is not None:
        raise RobotError(misread)
    if not path.is_file():
        return YamlTree({}, {})
    tree = read_yaml(path, RobotError)
    if not isinstance(tree.data, dict):
        raise RobotError.of(
            "yaml-mapping",
            file=str(path),
            line=1,
            value=type(tree.data).__name__,
            legal="a mapping of settings",
            fix="see the robots of the package",
        )
    return tree


def _misread(path: Path) -> Fault | None:
    """What stands in the place of robot.yaml without being it, so that it would be passed over."""

    def fault(code: str, value: str, legal: str, fix: str) -> Fault:
        return Fault(code, str(path), "robot.yaml", value, legal, fix)

    if path.is_dir():
        return fault("robot-yaml-kind", "a directory", "a file", "put the settings into a file")
    if path.is_symlink() and not path.exists():
        value = f"a link to {path.readlink()}, which is not there"
        return fault("robot-yaml-kind", value, "a file", "mend or remove the link")
    if path.exists() and not path.resolve().is_relative_to(path.parent.resolve()):
        value = f"a link to {path.readlink()}" if path.is_symlink() else str(path.resolve())
        return fault("path-outside", value, "a file in the URDF's folder", "copy it there")
    for name in ("robot.yml", "Robot.yaml", "robot.YAML"):
        other = path.with_name(name)
        if not path.exists() and (other.exists() or other.is_symlink()):
            return fault("robot-yaml-name", name, "robot.yaml", "rename it")
    return None


#: What rotors of arms of 3 to 200 kg payload have, seen from the joint: the torque limit over this
#: acceleration [rad/s²], within a factor of two.
ROTOR_RAD_S2 = 100.0
#: Acceleration limit over speed limit where no acceleration limit is given [1/s].
ACCELERATION_PER_SPEED = 10.0


#: Drives are taken to hold an arm and a load of LOAD times its mass, at x and z [m] of its flange,
#: and to reach full speed within RAMP_S [s], RESERVE times over.
LOAD, LOAD_AT_M, RESERVE, RAMP_S = 0.1, 0.1, 1.5, 0.3


def torque_assumed(urdf: Path, names: Sequence[str], torque_nm: Array) -> Fault:
    """The warning of torque limits that nobody gave."""
    value = f"no effort of {', '.join(names)}; {_numbers(torque_nm)} taken"
    fix = (
        f"give torque_limit_nm in robot.yaml; taken is {RESERVE:g} x what holding the arm with "
        f"{LOAD:g} of its mass at the flange and {RAMP_S:g} s to full speed take"
    )
    file = str(urdf.with_name("robot.yaml"))
    return Fault("torque-assumed", file, "torque_limit_nm", value, "N·m of each joint", fix)


#: An arm heavier than this times the cube of its stretched length (second to last joint) is doubted
#: [kg/m³]; IRB 6640, UR3 to UR10, Panda and KR 210 (at 1,100 kg) have 7 to 46.
MOST_KG_M3 = 80.0


def mass_doubts(urdf: Path, model: pin.Model) -> list[Fault]:
    """A warning where the arm's total mass does not go with its length."""
    mass = sum(inertia.mass for inertia in model.inertias)
    length = sum(float(np.linalg.norm(p.translation)) for p in list(model.jointPlacements)[2:])
    most = MOST_KG_M3 * length**3
    if length < 0.1 or mass <= most:
        return []
    value = f"{mass:,.0f} kg on {length:.2f} m from the second to the last joint"
    legal = f"<= {most:,.0f} kg ({MOST_KG_M3:g} kg/m³ times the length cubed)"
    fix = "compare with the data sheet; init --total-mass KG estimates masses anew"
    return [Fault("robot-mass", str(urdf), "mass", value, legal, fix)]


def assumptions(
    urdf: Path, tree: YamlTree, velocity_rad_s: Array, torque_nm: Array
) -> tuple[Fault, ...]:
    """What nobody gave and what was put in its place, as warnings."""
    file = str(urdf.with_name("robot.yaml"))
    given = set(tree.data)
    found = []
    if not tree.data:
        value = "no robot.yaml" if not urdf.with_name("robot.yaml").exists() else "nothing in it"
        legal = "armature, acceleration limits, drive, provenance"
        fix = "the URDF's limits are taken, no drive: electrical energy cannot be computed"
        found.append(Fault("robot-yaml-missing", file, "robot.yaml", value, legal, fix))
    if "acceleration_limit_rad_s2" not in given:
        taken = _numbers(ACCELERATION_PER_SPEED * velocity_rad_s)
        value = f"nothing; {taken} taken, {ACCELERATION_PER_SPEED:g} x the speed limits"
        fix = "give the acceleration limits of the arm"
        key = "acceleration_limit_rad_s2"
        found.append(Fault("acceleration-assumed", file, key, value, "rad/s² of each joint", fix))
    if "armature_kg_m2" not in given:
        fix = (
            f"give armature_kg_m2; an estimate from the torque limits is "
            f"{_numbers(torque_nm / ROTOR_RAD_S2)}, provenance: assumed"
        )
        value = "nothing; 0 taken, so the rotors weigh nothing in torque and energy"
        legal = "rotor inertia seen from each joint"
        found.append(Fault("armature-missing", file, "armature_kg_m2", value, legal, fix))
    return tuple(found)


def _numbers(values: Array) -> str:
    return "[" + ", ".join(f"{value:.3g}" for value in values) + "]"


def settings_faults(
    urdf: Path, tree: YamlTree, model: pin.Model, description: Description
) -> list[Fault]:
    """All faults of the settings for this model."""
    faults: list[Fault] = []

    def refuse(code: str, path: FieldPath, value: Any, legal: str, fix: str) -> None:
        faults.append(
            Fault(
                code,
                file=str(urdf.with_name("robot.yaml")),
                line=tree.line(path),
                field=field_name(path),
                value=str(value)[:120],
                legal=legal,
                fix=fix,
            )
        )

    settings = tree.data
    for key in sorted(settings.keys() - _KNOWN):
        legal, fix = ", ".join(sorted(_KNOWN)), "remove it or mend the spelling"
        refuse("robot-key", (key,), settings[key], legal, fix)
    if settings.get("schema_version", 1) != 1:
        version, fix = settings["schema_version"], "write schema_version: 1"
        refuse("schema-version", ("schema_version",), version, "1", fix)
    _check_vectors(settings, model, refuse)
    name = settings.get("name", "robot")
    if not isinstance(name, str) or not name.strip():
        refuse("robot-value", ("name",), name, "text", "name the robot")
    flange, last = settings.get("flange"), description.on_joint(len(description.chain))
    if flange is not None and flange not in last:
        fix = "name the link that carries the tool: the last moving joint must carry it"
        refuse("robot-flange", ("flange",), flange, ", ".join(last), fix)
    links = list(description.links)
    _check_locked(settings, description, refuse)
    use = settings.get("use_visual_shapes", False)
    if not isinstance(use, bool) and not (isinstance(use, list) and set(map(str, use)) <= {*links}):
        fix = "write true, or name the links"
        refuse("robot-value", ("use_visual_shapes",), use, "true, false or a list of links", fix)
    _check_sections(settings, model, refuse)
    _check_dynamics(settings, model, refuse)
    _check_provenance(settings, refuse)
    _check_pairs(settings, links, refuse)
    return faults


Refuse = Callable[[str, FieldPath, Any, str, str], None]


def _check_vectors(settings: dict[str, Any], model: pin.Model, refuse: Refuse) -> None:
    limits = {"q_lower_rad": model.lowerPositionLimit, "q_upper_rad": model.upperPositionLimit}
    for key, least in _VECTORS.items():
        if key not in settings:
            continue
        given = settings[key]
        value = _plain(given, *([model.nv] if isinstance(given, list) else []))
        most = _MOST.get(key, np.inf)
        if value is None or not np.all((value >= least) & (value <= most)):
            legal = f"{model.nv} finite numbers >= {least:g}"
            refuse("robot-value", (key,), given, legal, "one number per joint")
        elif key in limits:
            limits[key] = np.broadcast_to(value, (model.nv,))
    for i in np.flatnonzero(limits["q_lower_rad"] >= limits["q_upper_rad"]):
        both = f"{limits['q_lower_rad'][i]:g} to {limits['q_upper_rad'][i]:g}"
        path = ("q_lower_rad", int(i))
        refuse("limit-inverted", path, both, "lower < upper", "swap the limits")


def _plain(value: Any, *shape: int) -> Array | None:
    """`value` as finite numbers of this shape, None for anything else."""
    array = np.array(value, dtype=object)
    good = all(type(v) in (int, float) and abs(v) < 1e300 for v in array.flat)
    return array.astype(float) if good and array.shape == shape else None


def _check_dynamics(settings: dict[str, Any], model: pin.Model, refuse: Refuse) -> None:
    """Springs, the motors' coupling and the block that identify writes."""
    n, joints, code, rows = model.nv, list(model.names)[1:], "robot-value", 0
    ratio = _plain(settings.get("motor_from_joint", np.eye(n).tolist()), n, n)
    if ratio is not None and np.diag(ratio).all():
        ratio = ratio / np.diag(ratio)[:, None]
        rows = int(np.sum(np.abs(ratio).sum(axis=1) > 1.0 + 1e-9))
    if ratio is None or np.linalg.cond(ratio) > 1e6 or not np.diag(ratio).all():
        legal = f"{n} rows of {n} finite numbers, invertible, none of the diagonal 0"
        fix = "a row a motor: its speed by the speeds of the joints"
        refuse(code, ("motor_from_joint",), settings["motor_from_joint"], legal, fix)
    springs = settings.get("springs", [])
    for k, entry in enumerate(springs if isinstance(springs, list) else [springs]):
        given = {"scale": 1.0, **entry} if isinstance(entry, dict) else {}
        own = [_plain(given.get(key), *[2][: key == "anchors_m"]) for key in _SPRING]
        right = given.keys() == {"joint", "kind", *_SPRING} and given["kind"] == "gas"
        sizes = all(v is not None and (np.all(v > 0) or i > 3) for i, v in enumerate(own))
        if not right or not sizes or given["joint"] not in joints:
            legal = f"joint ({', '.join(joints)}), kind: gas, {', '.join(_SPRING)}"
            refuse(code, ("springs", k), entry, legal, "2 anchors; sizes are > 0")
    block = settings.get("identified", {})
    wrong: list[FieldPath] = [] if isinstance(block, dict) else [()]
    block = {"coupling": [[0, 0, 0]] * rows} if wrong else block
    wrong += [(k,) for k, v in block.items() if not isinstance(v, _IDENTIFIED.get(k, ()))]
    found = _plain(block.get("coupling") or np.zeros((0, 3)), rows, 3)
    if block and ("coupling",) not in wrong and (found is None or not np.all(found >= 0)):
        wrong.append(("coupling",))
    for path in wrong:
        legal = f"a mapping of {', '.join(_IDENTIFIED)}; coupling: {rows} rows of 3 numbers >= 0"
        fix = "let dmoc identify write it"
        refuse(code, ("identified", *path), settings["identified"], legal, fix)


def _check_locked(settings: dict[str, Any], description: Description, refuse: Refuse) -> None:
    locked = settings.get("locked", {})
    if not isinstance(locked, dict):
        refuse("robot-value", ("locked",), locked, "a mapping", "write locked: {JOINT: 0.0}")
        return
    for name, value in locked.items():
        plain = _plain(value)
        if name not in description.joints:
            legal = ", ".join(description.joints)
            refuse("name-unknown", ("locked", name), name, legal, "name a joint of the URDF")
        elif plain is None or not abs(plain) < 50:
            refuse("robot-value", ("locked", name), value, "a finite number", "give rad or m")


def _check_sections(settings: dict[str, Any], model: pin.Model, refuse: Refuse) -> None:
    drive = settings.get("drive")
    if drive is not None and not isinstance(drive, dict):
        refuse("robot-value", ("drive",), drive, "a mapping", "write drive: {class: heavy}")
        drive = None
    controller = settings.get("controller")
    for section, read in ((drive, drive_from_mapping), (controller, controller_from_mapping)):
        try:
            if section is not None:
                read(section, model.nv)
        except DmocError as error:
            for fault in error.faults:
                path = tuple(fault.field.split("."))
                refuse(fault.code, path, fault.value, fault.legal, fault.fix or "mend the value")


def _check_provenance(settings: dict[str, Any], refuse: Refuse) -> None:
    tags = settings.get("provenance", {})
    if not isinstance(tags, dict):
        refuse("provenance-tag", ("provenance",), tags, "a mapping", f"write KEY: {_TAGS}")
        return
    for key, tag in tags.items():
        known = tag in ("measured", "assumed")
        if not known and not (isinstance(tag, str) and tag.startswith("published: ")):
            refuse("provenance-tag", ("provenance", key), tag, _TAGS, "tag where it comes from")


def _check_pairs(settings: dict[str, Any], frames: list[str], refuse: Refuse) -> None:
    pairs = settings.get("allowed_collisions", [])
    if not isinstance(pairs, list):
        refuse(
            "robot-value", ("allowed_collisions",), pairs, "a list of pairs", "write - [link, link]"
        )
        return
    for index, pair in enumerate(pairs):
        path: FieldPath = ("allowed_collisions", index)
        if not isinstance(pair, list) or len(pair) != 2:
            refuse("robot-value", path, pair, "two link names", "write - [link, link]")
            continue
        for link in pair:
            if link not in frames:
                refuse("name-unknown", path, link, ", ".join(frames), "name links of the URDF")
