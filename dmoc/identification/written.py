"""An identification as a robot's files, and the torque that such files predict."""

from __future__ import annotations

import json
import re
from pathlib import Path
from typing import Any

import numpy as np
import pinocchio as pin
import yaml

from dmoc.arrays import Array
from dmoc.errors import Fault, InputError, RobotError
from dmoc.identification.consistent import link_numbers, pseudo_inertia
from dmoc.identification.identifying import Identification
from dmoc.identification.samples import Samples
from dmoc.identification.terms import TermColumns, couplings_of, springs_of
from dmoc.robot.drive import drive_from_mapping
from dmoc.robot.packages import with_meshes
from dmoc.robot.robot import Robot, load_robot
from dmoc.robot.settings import read_settings

_LINK = ("mass", "first moments", "inertia")


def write_identification(result: Identification, folder: Path | str) -> tuple[Path, ...]:
    """robot.urdf (only `<inertial>` replaced) with its meshes, robot.yaml, report.json; the prior
    stays.

    Errors: `InputError` with the faults of a log that cannot be believed.
    """
    if result.status == "faulty":
        raise InputError(result.faults)
    folder = Path(folder)
    folder.mkdir(parents=True, exist_ok=True)
    paths = tuple(folder / name for name in ("robot.urdf", "robot.yaml", "report.json"))
    meshes = result.problem.robot.description.meshes
    paths[0].write_bytes(with_meshes(_urdf(result).encode(), meshes, folder))
    text = yaml.safe_dump(_settings(result), sort_keys=False, allow_unicode=True, width=100)
    paths[1].write_text(text, encoding="utf-8")
    paths[2].write_text(json.dumps(summary(result), indent=1), encoding="utf-8")
    return paths


def read_identified(urdf: Path | str) -> tuple[Robot, TermColumns, Array]:
    """A written pair: the robot, its columns and its parameters.

    Errors: `RobotError` for a robot.yaml without friction, or with faults in these entries.
    """
    robot = load_robot(urdf)
    settings = read_settings(Path(robot.urdf)).data
    n, names = robot.num_joints, list(robot.model.names)[1:]
    block = settings.get("identified")
    if not isinstance(block, dict) or not robot.drive:
        legal, fix = "a drive and an identified block", "write it with dmoc identify"
        raise RobotError(Fault("robot-value", str(urdf), "identified", "missing", legal, fix))
    ratio = np.array(settings.get("motor_from_joint", np.eye(n)), dtype=float)
    layout = TermColumns(
        robot.model, couplings_of(ratio), springs_of(settings.get("springs", []), names)
    )
    out = np.zeros(layout.size)
    links = [pin.Inertia(robot.model.inertias[i]).toDynamicParameters() for i in range(1, n + 1)]
    out[: layout.num_links] = np.concatenate(links)
    drive = drive_from_mapping(robot.drive, n)
    out[layout.block("armature")] = robot.armature_kg_m2
    out[layout.block("coulomb")] = drive.coulomb_nm
    out[layout.block("viscous")] = drive.viscous_nm_s
    out[layout.block("offset")] = settings.get("torque_offset_nm", 0.0)
    out[layout.block("coupling")] = np.ravel(block.get("coupling", []))
    out[layout.block("springs")] = [spring.scale for spring in layout.springs]
    return robot, layout, out


def predicted_torque_nm(urdf: Path | str, samples: Samples) -> Array:
    """Torque (M, n) that a written pair predicts, without payload."""
    _, layout, parameters = read_identified(urdf)
    return np.asarray(layout.regressor(samples) @ parameters)


def summary(result: Identification) -> dict[str, Any]:
    """Plain numbers of the result: what `--json` and report.json give."""
    names = list(result.problem.robot.model.names)[1:]
    blocks = ("armature", "coulomb", "viscous", "offset", "coupling", "springs")
    parts: dict[str, Any] = {}
    for name in blocks:
        part = result.layout.block(name)
        parts[name] = {
            "value": result.parameters[part].tolist(),
            "std": result.std[part].tolist(),
            "measured": result.measured[part].tolist(),
        }
    links = result.parameters[: result.layout.num_links].reshape(-1, 10)
    wide = result.std[: result.layout.num_links].reshape(-1, 10)
    prior = result.prior[: result.layout.num_links].reshape(-1, 10)
    known = result.measured[: result.layout.num_links].reshape(-1, 10)
    return {
        "status": result.status,
        "joints": names,
        "held_out": result.held_out,
        "scores": [
            {
                "run": s.name,
                "seconds": round(s.seconds, 3),
                "rel_percent": [None if np.isnan(v) else v for v in s.rel_percent],
                "rms_nm": list(s.rms_nm),
                "energy_j": s.energy_j,
                "energy_percent": s.energy_percent,
                "assumed_energy_percent": s.assumed_energy_percent,
            }
            for s in result.scores
        ],
        "links": [
            {
                "joint": name,
                "mass_kg": float(row[0]),
                "mass_std_kg": float(spread[0]),
                "prior_mass_kg": float(old[0]),
                "measured": {
                    _LINK[0]: bool(ok[0]),
                    _LINK[1]: bool(ok[1:4].all()),
                    _LINK[2]: bool(ok[4:].all()),
                },
            }
            for name, row, spread, old, ok in zip(names, links, wide, prior, known)
        ],
        **parts,
        "covered": {key: value.tolist() for key, value in result.covered.items()},
        "torque_delay_s": result.delay_s,
        "faults": [fault.to_dict() for fault in result.faults],
        "warnings": [fault.to_dict() for fault in result.warnings],
        "unidentifiable": list(result.unidentifiable),
    }


def _settings(result: Identification) -> dict[str, Any]:
    robot, layout = result.problem.robot, result.layout
    given = read_settings(robot.urdf).data
    tags = dict(given.get("provenance", {}))
    out = {**given, "armature_kg_m2": result.named("armature").tolist()}
    out["torque_offset_nm"] = result.named("offset").tolist()
    ratio = result.problem.motor_from_joint
    drive = dict(given.get("drive") or {"class": "heavy"})
    if not given.get("drive") and ratio is not None:
        drive["gear_ratio"] = np.abs(np.diag(ratio)).tolist()
    drive["coulomb_nm"] = result.named("coulomb").tolist()
    drive["viscous_nm_s"] = result.named("viscous").tolist()
    out["drive"] = drive
    if ratio is not None:
        out["motor_from_joint"] = np.asarray(ratio).tolist()
    springs = []
    for entry, spring, scale in zip(
        given.get("springs", [{}] * len(layout.springs)), layout.springs, result.named("springs")
    ):
        own = {
            "joint": list(robot.model.names)[1 + spring.joint],
            "kind": "gas",
            "anchors_m": list(spring.anchors_m),
            "zero_rad": spring.zero_rad,
            "area_m2": spring.area_m2,
            "volume_m3": spring.volume_m3,
            "gas_j": spring.gas_j,
        }
        springs.append({**own, **entry, "scale": float(scale)})
    if springs:
        out["springs"] = springs
    wholes = {"armature": "armature_kg_m2", "coulomb": "coulomb_nm", "viscous": "viscous_nm_s"}
    for block, key in wholes.items():
        all_known = bool(result.measured[layout.block(block)].all())
        tags[key] = "measured" if all_known else "assumed"
    known = result.measured[: layout.num_links].reshape(-1, 10)
    tags["mass"] = "measured" if known[:, 0].all() else "assumed"
    tags["inertia"] = "measured" if known[:, 4:].all() else "assumed"
    out["provenance"] = tags
    if isinstance(given.get("inertials"), dict):
        moved = {link for i in range(layout.num_joints) for link in _carried(robot, i)}
        kept = {k: v for k, v in given["inertials"].items() if k not in moved}
        out["inertials"] = kept
    whole = summary(result)
    out["identified"] = {
        "status": result.status,
        "logs": [
            {"name": log.name, "sha256": f"sha256:{log.sha256}"} for log in result.problem.logs
        ],
        "range": whole["covered"],
        "held_out" if result.held_out else "fitted": {
            str(score["run"]): {key: score[key] for key in ("rel_percent", "energy_percent")}
            for score in whole["scores"]
        },
        "coupling": result.named("coupling").reshape(-1, 3).tolist(),
        "std": {block: whole[block]["std"] for block in (*wholes, "offset", "springs")},
        "measured": {block: whole[block]["measured"] for block in (*wholes, "offset", "springs")},
        "links": {
            name: {"mass_std_kg": link["mass_std_kg"], **link["measured"]}
            for name, link in zip(whole["joints"], whole["links"])
        },
    }
    return out


def _carried(robot: Robot, index: int) -> tuple[str, ...]:
    return robot.description.on_joint(index + 1)


def _urdf(result: Identification) -> str:
    robot = result.problem.robot
    text = robot.description.text or robot.urdf.read_text(encoding="utf-8")
    for i, joint in enumerate(robot.description.chain):
        child = robot.description.joints[joint].child
        own = _inertial(result.parameters[10 * i : 10 * i + 10])
        for link in _carried(robot, i):
            text = _replace(text, link, own if link == child else "")
    return text


def _inertial(pi: Array) -> str:
    body = pin.Inertia.FromDynamicParameters(link_numbers(pseudo_inertia(pi)))
    t = body.inertia
    tensor = " ".join(
        f'i{"xyz"[a]}{"xyz"[b]}="{float(t[a, b])!r}"'
        for a, b in ((0, 0), (0, 1), (0, 2), (1, 1), (1, 2), (2, 2))
    )
    xyz = " ".join(repr(float(v)) for v in body.lever)
    return (
        f'<inertial><origin xyz="{xyz}" rpy="0 0 0"/><mass value="{float(body.mass)!r}"/>'
        f"<inertia {tensor}/></inertial>"
    )


def _replace(text: str, link: str, inertial: str) -> str:
    """The text with the `<inertial>` of one link replaced, everything else byte for byte."""
    name = re.escape(link)
    head = re.search(rf"<link\b[^>]*\bname\s*=\s*[\"']{name}[\"'][^>]*?(/?)>", text)
    if head is None:
        legal, fix = "a link written out in the URDF", "expand the file first"
        raise RobotError(Fault("urdf-link", "", f"link {link}", "not found", legal, fix))
    if head.group(1):
        opened = text[head.start() : head.end() - 2] + ">" + inertial + "</link>"
        return text[: head.start()] + (opened if inertial else head.group(0)) + text[head.end() :]
    end = text.index("</link>", head.end())
    body = text[head.end() : end]
    old = re.search(r"<inertial\b.*?</inertial>", body, re.S)
    if old is None:
        body = inertial + body
    else:
        body = body[: old.start()] + inertial + body[old.end() :]
    return text[: head.end()] + body + text[end:]
