"""Figures of the UR3 study, after Figs. 4, 6, 7, 9 and 10 of its paper."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from dmoc.arrays import Array
from dmoc.motion.trajectory import JointTrajectory, inverse_dynamics
from dmoc.physics.metrics import MotionState, motor_current_a, settled
from dmoc.robot.drive import drive_from_mapping
from dmoc.robot.robot import Robot
from studies.ur3.bezier_motion import BezierMotion

Curve = BezierMotion | JointTrajectory


def _state(motion: Curve, t: Array) -> tuple[Array, Array, Array]:
    if isinstance(motion, BezierMotion):
        return motion.derivative(t, 0), motion.derivative(t, 1), motion.derivative(t, 2)
    sample = motion.sample(motion.t_s[0] + t)
    return sample.q_rad, sample.velocity_rad_s, sample.acceleration_rad_s2


def currents_of(motion: Curve, robot: Robot, t: Array) -> Array:
    """Motor currents (K, n) [A] at times t (K,), by the robot's drive model."""
    q, v, a = _state(motion, t)
    torque = inverse_dynamics(robot.model, q, v, a)
    drive = drive_from_mapping(robot.drive, robot.num_joints, robot.provenance)
    return motor_current_a(drive, MotionState(settled(np.array(v)), a, a, torque))


def streamed(motion: BezierMotion, step_s: float, t: Array) -> Array:
    """What servoj makes of points every `step_s`: straight lines between them (K, n)."""
    count = int(np.ceil(motion.duration_s / step_s - 1e-9))
    points = np.minimum(np.arange(count + 1) * step_s, motion.duration_s)
    q = motion.derivative(points, 0)
    return np.column_stack([np.interp(t, np.arange(count + 1) * step_s, column) for column in q.T])


def draw_convergence(axes: Any, histories: Sequence[Array], baseline_j: float) -> None:
    """Best energy after each iteration, every run (Fig. 4)."""
    for history in histories:
        axes.plot(np.arange(1, len(history) + 1), history, color="tab:red", lw=0.8)
    axes.axhline(baseline_j, color="tab:blue", label="movej")
    axes.set(xlabel="iteration", ylabel="Σ∫|I|·V dt [J]")
    axes.legend(loc="upper right")


def draw_sampling(axes: Any, motion: BezierMotion, steps_s: Sequence[float], joint: int) -> None:
    """Deviation of streamed points from the curve, one joint (Fig. 6b)."""
    t = np.linspace(0.0, motion.duration_s, 2000)
    exact = motion.derivative(t, 0)[:, joint]
    for step in steps_s:
        error = streamed(motion, step, t)[:, joint] - exact
        axes.plot(t, 1e3 * error, lw=0.8, label=f"servoj {1000 * step:.0f} ms")
    axes.set(xlabel="t [s]", ylabel=f"deviation of joint {joint + 1} [mrad]")
    axes.legend()


def draw_currents(axes: Sequence[Any], motions: Mapping[str, Curve], robot: Robot) -> None:
    """Motor currents of every joint (Figs. 7 and 9); one of `axes` per joint."""
    for name, motion in motions.items():
        t = np.linspace(0.0, motion.duration_s, 400)
        for joint, current in enumerate(currents_of(motion, robot, t).T):
            axes[joint].plot(t, current, lw=1.0, label=name)
    for joint, axis in enumerate(axes):
        axis.set(title=f"joint {joint + 1}", xlabel="t [s]", ylabel="I [A]")
    axes[0].legend()


def draw_joints(axes: Sequence[Any], motions: Mapping[str, Curve]) -> None:
    """Joint angles over time, with the control points of Bézier motions (Fig. 9, below)."""
    for name, motion in motions.items():
        t = np.linspace(0.0, motion.duration_s, 300)
        for joint, q in enumerate(_state(motion, t)[0].T):
            (line,) = axes[joint].plot(t, q, lw=1.0, label=name)
            if isinstance(motion, BezierMotion):
                at = np.linspace(0.0, motion.duration_s, motion.degree + 1)
                points = motion.control_rad[:, joint]
                axes[joint].plot(at, points, "o", ms=3, color=line.get_color())
    for joint, axis in enumerate(axes):
        axis.set(title=f"joint {joint + 1}", xlabel="t [s]", ylabel="q [rad]")
    axes[0].legend()


def draw_tip(axes: Any, motions: Mapping[str, Curve], robot: Robot) -> None:
    """The flange's way in space; movej dotted as in Fig. 10. `axes` is a 3D plot."""
    for name, motion in motions.items():
        t = np.linspace(0.0, motion.duration_s, 120)
        way = np.array([robot.flange_pose(q).translation for q in _state(motion, t)[0]])
        axes.plot(*way.T, ":" if name == "movej" else "-", label=name)
    axes.set(xlabel="x [m]", ylabel="y [m]", zlabel="z [m]")
    axes.legend()
