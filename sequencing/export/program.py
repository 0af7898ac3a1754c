"""A run as few targets with times: fitted, proven free for every zone, judged as it will run."""

from __future__ import annotations

import re
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np
import pinocchio as pin

from dmoc.arrays import Array
from dmoc.errors import InputError
from dmoc.motion.cost import Cost, ElectricalCost
from dmoc.motion.trajectory import JointTrajectory, inverse_dynamics
from dmoc.physics.running_cost import trajectory_cost
from dmoc.robot.controller import HOME_DEG, Controller
from dmoc.robot.robot import Robot, available_robots, load_robot
from planning.collision.certificate import prove_curve
from planning.collision.world import CollisionWorld, EdgeClearance
from planning.station.station import Station
from planning.welds.poses import weld_line
from sequencing.cycle_types import CycleMotion
from sequencing.export.fitting import (
    TOLERANCES_RAD,
    Stretch,
    Targets,
    spline_targets,
    zone_targets,
)
from sequencing.runs.clock import trajectory_of
from sequencing.runs.folder import Run, station_of

Model = Literal["zones", "spline", "cubic"]
_HALVINGS = 6


@dataclass(frozen=True)
class Program:
    """What a program of `run` tells its controller: targets by motion key (none for `cubic`, which
    sends the plan's own knots), the number of every stud, and what the head and the report say."""

    run: Run
    robot: Robot
    controller: Controller
    targets: dict[str, Targets]
    numbers: dict[str, int]
    report: dict[str, Any]

    def head(self) -> list[str]:
        """Deviation, duration, J and clearance of the program, as lines of its head."""
        r = self.report
        return [
            f"{r['points']} targets. Program: {r['duration_s']:.3f} s, J {r['cost']:.6g} (plan: "
            f"{r['planned_duration_s']:.3f} s, J {r['planned_cost']:.6g})",
            f"Largest deviation from the plan {r['deviation_rad']:.2e} rad as modelled, "
            f"{r['worst_deviation_rad']:.2e} rad whatever the controller blends",
            f"Peak speed {r['speed_share']:.2f} and peak torque {r['torque_share']:.2f} of the "
            "planned robot's limits; 'as modelled' was never measured on a controller",
            f"Clearance: {r['clearance']}",
        ]


def controller_of(run: Run, vendor: str, language: str) -> tuple[Robot, Controller]:
    """Robot and map of a run for a language; `InputError` export-controller where it is missing,
    of another vendor, or misses the home that was stated in both notations."""
    robot = run.robot
    controller = None if robot is None else robot.controller
    if robot is not None and controller is None and robot.name in available_robots():
        ours = load_robot(robot.name)  # the run may keep a copy that is older than the section
        if ours.description.joints == robot.description.joints:
            controller = ours.controller
    value, legal = "", f"a controller section (vendor {vendor}) in robot.yaml"
    fix = "say vendor, sign, offset_deg and coupling there, plan again (solved edges are reused)"
    if robot is None:
        value = run.robot_note
    elif controller is None:
        value = "nothing says how the controller counts the joints"
    elif controller.vendor not in (vendor, "any"):
        value, fix = f"vendor {controller.vendor}", f"{language} is of {vendor}: choose its format"
    elif (error := controller.home_error_deg()) > HOME_DEG:
        value = f"the map misses the stated home by {error:.3g} deg"
        fix = "mend sign, offset_deg, coupling or home"
    else:
        return robot, controller
    raise InputError.of("export-controller", str(run.folder), "robot.controller", value, legal, fix)


def program_of(run: Run, model: Model, vendor: str, language: str) -> Program:
    """The motions of `run` for a controller of that model.

    Where the run has a station, every curve that the controller might make of the targets is
    proven to keep the certificate's distance; where clearance is short, more targets are taken.
    Errors: `InputError` export-controller, export-joints, export-clearance, export-target.
    """
    robot, controller = controller_of(run, vendor, language)
    try:
        station = station_of(run) if run.planned and model != "cubic" else None
    except InputError:
        station = None
    prove = None if station is None else _prover(station)
    targets: dict[str, Targets] = {}
    for item in run.motions if model != "cubic" else ():
        targets[item.key] = _fitted(item, robot, model, prove, str(run.folder))
    _check_targets(run, controller, targets)
    ids = sorted({weld.stud for weld in run.welds})
    digits = [re.search(r"(\d{1,6})$", stud) for stud in ids]
    own = [int(hit.group(1)) for hit in digits if hit]
    numbers = dict(zip(ids, own if len(set(own)) == len(ids) else range(1, len(ids) + 1)))
    report = _report(run, robot, targets)
    report["model"] = model
    if model == "cubic":
        report["clearance"] = "that of the plan, whose curve this is"
    elif prove is None:
        report["clearance"] = "NOT proven for this program: its station is not there"
    else:
        every = {"zones": "zone share from none to half"}
        every["spline"] = "curve between the chords and the spline"
        report["clearance"] = f"proven for every {every[model]}"
    report["studs"] = numbers
    return Program(run, robot, controller, targets, numbers, report)


def _fitted(
    item: CycleMotion,
    robot: Robot,
    model: Model,
    prove: Callable[[CycleMotion, tuple[Stretch, ...]], bool] | None,
    file: str,
) -> Targets:
    plan = trajectory_of(item)
    for tolerance in TOLERANCES_RAD:
        if model == "zones":
            found = zone_targets(plan, robot, tolerance)
        else:
            found = spline_targets(plan, tolerance)
        if prove is None or prove(item, found.pieces):
            return found
    raise InputError.of(
        "export-clearance",
        file,
        f"motions.{item.key}",
        f"no proof that every zone keeps clear with {len(found.q_rad)} targets",
        "a program that keeps clear whatever the controller blends",
        "use ros, csv or urscript, or plan with a larger clearance_m",
    )


def _prover(station: Station) -> Callable[[CycleMotion, tuple[Stretch, ...]], bool]:
    world = CollisionWorld(station)
    lines = {stud.id: weld_line(station, stud) for stud in station.studs if stud.on}

    def prove(item: CycleMotion, pieces: tuple[Stretch, ...]) -> bool:
        ends = (lines.get(item.origin), lines.get(item.target))
        return all(_proven(world.clearance(*ends), piece) for piece in pieces)

    return prove


def _proven(clearance: EdgeClearance, piece: Stretch) -> bool:
    """Whether the curves of all λ are free: halves of [0, most], each by its middle curve, which
    must be as far off as no other of the half can leave it."""
    least = clearance.tracking_error_m
    middle = piece.curve(piece.most / 2)
    span = np.ptp(middle.q_rad, axis=0)
    reach = clearance.reach(middle.q_rad).max(axis=0)
    # Between the knots a point is farther from an axis by no more than it travels.
    leave = float((reach + 1.5 * reach @ span) @ piece.rate)
    halves = [(0.0, piece.most, 0)]
    while halves:
        low, high, depth = halves.pop()
        clearance.tracking_error_m = least + leave * (high - low) / 2
        mid = (low + high) / 2
        if prove_curve(clearance, piece.curve(mid)):
            continue
        if depth == _HALVINGS:
            return False
        halves += [(low, mid, depth + 1), (mid, high, depth + 1)]
    return True


def _check_targets(run: Run, controller: Controller, targets: dict[str, Targets]) -> None:
    """No target beyond the controller's own ranges."""
    if controller.limits_deg is None:
        return
    low, high = controller.limits_deg.T
    for item in run.motions:
        points = targets[item.key].q_rad if item.key in targets else trajectory_of(item).q_rad
        degrees = controller.degrees(points)
        excess = np.maximum(degrees - high, low - degrees)
        if excess.max() > 1e-6:
            k, j = np.unravel_index(int(excess.argmax()), excess.shape)
            raise InputError.of(
                "export-target",
                str(run.folder),
                f"motions.{item.key}.axis[{j}]",
                f"{degrees[k, j]:.6g} deg",
                f"{low[j]:.6g} to {high[j]:.6g} deg (controller.limits_deg)",
                "narrow the limits in robot.yaml and plan again",
            )


def _report(run: Run, robot: Robot, targets: dict[str, Targets]) -> dict[str, Any]:
    entry = dict(run.result["cost"])
    cost = {"Cost": Cost, "ElectricalCost": ElectricalCost}[entry.pop("kind")](**entry)
    rows: list[dict[str, Any]] = []
    total = np.zeros(2)
    for item in run.motions:
        plan = trajectory_of(item).on(None)
        fit = targets.get(item.key)
        curve = plan if fit is None else fit.curve
        total += [trajectory_cost(c, robot, cost) for c in (curve, plan)]
        speed, torque = _peaks(curve, robot)
        rows.append(
            {
                "key": item.key,
                "points": plan.num_intervals if fit is None else len(fit.times_s),
                "duration_s": curve.duration_s,
                "deviation_rad": 0.0 if fit is None else fit.deviation_rad,
                "worst_deviation_rad": 0.0 if fit is None else fit.worst_rad,
                "speed_share": speed,
                "torque_share": torque,
            }
        )
    names = ("deviation_rad", "worst_deviation_rad", "speed_share", "torque_share")
    most = {name: max((float(row[name]) for row in rows), default=0.0) for name in names}
    return {
        "points": sum(row["points"] for row in rows),
        "duration_s": float(sum(row["duration_s"] for row in rows)),
        "planned_duration_s": float(sum(trajectory_of(item).duration_s for item in run.motions)),
        "cost": float(total[0]),
        "planned_cost": float(total[1]),
        **most,
        "motions": rows,
    }


def _peaks(curve: JointTrajectory, robot: Robot) -> tuple[float, float]:
    """Largest share of the speed and of the torque limits along a curve."""
    inside = curve.t_s[:-1, None] + np.diff(curve.t_s)[:, None] * (np.arange(4) / 4 + 1e-6)
    q, v, a, _ = curve.sample(np.append(inside.ravel(), curve.t_s[-1]))
    torque = inverse_dynamics(robot.model, q, v, a)
    return (
        float(np.max(np.abs(v) / robot.velocity_limit_rad_s)),
        float(np.max(np.abs(torque) / robot.torque_limit_nm)),
    )


def tip_of(robot: Robot, controller: Controller) -> pin.SE3:
    """T_tool0_tip."""
    return controller.tool0.inverse() * robot.tool.tip


def load_of(robot: Robot, controller: Controller) -> tuple[float, Array, Array, Array]:
    """Tool and payload in tool0: mass [kg], centre [m], principal axes and moments [kg m2]."""
    tool = robot.tool
    load = pin.Inertia(tool.mass_kg, np.array(tool.com_m), np.array(tool.inertia_kg_m2))
    if robot.payload_kg:
        load += pin.Inertia(robot.payload_kg, tool.tip.translation, np.zeros((3, 3)))
    load = controller.tool0.inverse().act(load)
    inertia = np.array(load.inertia)
    if np.allclose(inertia, np.diag(np.diag(inertia)), atol=1e-9):
        return load.mass, load.lever, np.eye(3), np.diag(inertia)
    moments, axes = np.linalg.eigh(inertia)
    axes[:, 2] *= np.sign(np.linalg.det(axes))
    return load.mass, load.lever, axes, moments


def world_of(robot: Robot, controller: Controller) -> pin.SE3:
    """The station's axes in the controller's base: the work frame."""
    return (robot.base * controller.base).inverse()
