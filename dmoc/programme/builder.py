"""The programme of a motion: which stages, which rows, where each parameter goes.

A programme depends on the arm, the kind of cost, N and the families of rows it carries; boundary
states, limits, weights, boxes and half-spaces are parameters and bounds of it. Programmes are kept
for the life of the process.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from dmoc.errors import ProblemError
from dmoc.motion.cost import Cost
from dmoc.motion.motion import MotionProblem
from dmoc.physics.dynamics import ArmModel, arm_model
from dmoc.programme import limit_stages as limits
from dmoc.programme.codegen import Backend, StageSet
from dmoc.programme.cost_stages import (
    Rate,
    electrical_rate,
    matrix_rate,
    midpoint_cost_stage,
    quadratic_rate,
    spread_cost_stage,
)
from dmoc.programme.stages import Stage, dynamics_stage
from dmoc.programme.transcription import Block, Index, Layout, Programme, assemble
from dmoc.robot.drive import drive_from_mapping
from dmoc.robot.robot import Robot

_ARMS: dict[str, ArmModel] = {}
_STAGES: dict[tuple[Any, ...], StageSet] = {}
_PROGRAMMES: dict[tuple[Any, ...], MotionProgramme] = {}


@dataclass(frozen=True)
class Families:
    """Which rows a programme carries beside those that its problem always has.

    `half_spaces` is their number per interval.
    """

    velocity: bool = False
    acceleration: bool = False
    half_spaces: int = 0

    @property
    def limited(self) -> bool:
        """Whether there are rows of speed or acceleration."""
        return self.velocity or self.acceleration


@dataclass(frozen=True)
class MotionProgramme:
    """A programme with the places of its parameters (`params`) and rows (`rows`).

    `blocks` are what it was assembled from.
    """

    programme: Programme
    layout: Layout
    params: dict[str, Index]
    rows: dict[str, Index]
    key: tuple[Any, ...]
    blocks: tuple[Block, ...]

    def pack(self, **values: Any) -> np.ndarray:
        """The parameter vector; names that the programme does not carry are left out."""
        p = np.zeros(self.programme.num_params)
        for name, index in self.params.items():
            p[index] = values[name]
        return p


def arm_of(robot: Robot) -> ArmModel:
    """The numbers of the robot's dynamics, kept per fingerprint; wrenches act at the tool tip."""
    if robot.fingerprint not in _ARMS:
        frame = robot.model.frames[robot.flange_id]
        tip = (frame.placement * robot.tool.tip).translation
        _ARMS[robot.fingerprint] = arm_model(robot.model, int(frame.parentJoint) - 1, tip)
    return _ARMS[robot.fingerprint]


def motion_programme(problem: MotionProblem, families: Families) -> MotionProgramme:
    """The programme for `problem` with `families` of rows, built once per process and backend."""
    physics, stages = stages_of(problem)
    backend = stages.current()
    jerk = problem.jerk_limit_rad_s3 is not None
    key = (*physics, backend.name, problem.num_intervals, problem.limits.shape, jerk, families)
    if key not in _PROGRAMMES:
        _PROGRAMMES[key] = Builder(problem, backend, families).build(key)
    return _PROGRAMMES[key]


def stages_of(problem: MotionProblem) -> tuple[tuple[Any, ...], StageSet]:
    """What dynamics and cost depend on, and their stages."""
    robot, cost = problem.robot, problem.cost
    kind = type(cost).__name__
    if isinstance(cost, Cost) and cost.has_matrices:
        kind = "matrices"
    drive = ""
    if not isinstance(cost, Cost):
        drive = repr((sorted(robot.drive.items()), cost.friction_smoothing_rad_s))
    spread = cost.kappa > 0
    physics = (robot.fingerprint, kind, drive, spread, problem.wrench is not None)
    if physics not in _STAGES:
        dynamics = dynamics_stage(arm_of(robot), problem.wrench is not None)
        _STAGES[physics] = StageSet((dynamics, _cost_stage(problem)))
    return physics, _STAGES[physics]


def _cost_stage(problem: MotionProblem) -> Stage:
    rate = _cost_rate(problem)
    if problem.cost.kappa == 0:
        return midpoint_cost_stage(problem.robot.num_joints, rate)
    return spread_cost_stage(arm_of(problem.robot), rate, problem.wrench is not None)


def _cost_rate(problem: MotionProblem) -> Rate:
    n, cost = problem.robot.num_joints, problem.cost
    if isinstance(cost, Cost):
        return matrix_rate(n) if cost.has_matrices else quadratic_rate()
    drive = drive_from_mapping(problem.robot.drive, n)
    if np.any(drive.extra_inertia_kg_m2):
        raise ProblemError.of(
            "extra-inertia",
            field="drive.extra_inertia_kg_m2",
            value=str(drive.extra_inertia_kg_m2),
            legal="0 in an optimisation",
            fix="count it in armature_kg_m2, where the dynamics see it",
        )
    return electrical_rate(n, drive, cost.friction_smoothing_rad_s)


class Places:
    """Hands out consecutive positions by name."""

    def __init__(self) -> None:
        self.places: dict[str, Index] = {}
        self.size = 0

    def take(self, name: str, *shape: int) -> Index:
        """New positions of that shape, or those that the name already has."""
        if name not in self.places:
            count = int(np.prod(shape))
            index = np.arange(self.size, self.size + count).reshape(shape)
            self.places[name], self.size = index, self.size + count
        return self.places[name]


class Builder:
    """Collects the blocks of one programme."""

    def __init__(self, problem: MotionProblem, backend: Backend, families: Families) -> None:
        self.problem, self.limits = problem, problem.limits
        self.n, self.count = problem.robot.num_joints, problem.num_intervals
        self.layout = Layout(self.count, self.n, problem.limits.needs_end_state)
        self.families = families
        self.params, self.rows = Places(), Places()
        self.blocks: list[Block] = []
        self.stages = backend.stages

    def build(self, key: tuple[Any, ...]) -> MotionProgramme:
        families = self.families
        self._motion()
        if families.velocity:
            self._velocity()
        if families.acceleration:
            self._acceleration()
        if families.half_spaces:
            self._half_spaces(families.half_spaces)
        if self.problem.jerk_limit_rad_s3 is not None:
            self._jerk()
        self._torques()
        self._user_rows()
        programme = assemble(self.blocks, self.layout.size, self.rows.size, self.params.size)
        return MotionProgramme(
            programme, self.layout, self.params.places, self.rows.places, key, tuple(self.blocks)
        )

    def _param(self, *names: str) -> Index:
        """Positions of joint vectors."""
        return np.concatenate([self.params.take(name, self.n) for name in names])

    def _add(self, stage: Stage, variables: Index, theta: Index, rows: Index | None) -> None:
        """`variables` and `rows` one line per copy."""
        self.blocks.append(Block(stage, variables.T, theta, None if rows is None else rows.T))

    def _steps(self, copies: int) -> Index:
        return np.full((copies, 1), self.layout.step)

    def _motion(self) -> None:
        """Equations of motion, cost and smoothing: what every programme has."""
        dynamics, cost = self.stages
        intervals, torques = self.layout.intervals().T, self.layout.torques()
        momentum = self.rows.take("momentum", self.count + 1, self.n)
        theta = self._param("scale", "u_max")
        if self.problem.wrench is not None:
            theta = np.concatenate([theta, self.params.take("wrench", 6)])
        self._add(dynamics, intervals, theta, np.hstack([momentum[:-1], momentum[1:]]))
        self._add(cost, intervals, self._cost_params(), None)
        pairs = np.hstack([torques[:-1], torques[1:]])
        self._add(limits.smoothing_stage(self.n), pairs, self.params.take("smoothing", 1), None)
        if self.layout.end_velocity:
            arm = arm_of(self.problem.robot)
            last = np.concatenate([self.layout.knots()[-1], self.layout.last_velocity()])[None]
            self._add(limits.end_momentum_stage(arm), last, self._param("scale"), momentum[-1:])

    def _cost_params(self) -> Index:
        """(weights, u_max), and the wrench where the cost depends on accelerations."""
        cost = self.problem.cost
        weights = self.params.take("weights", len(cost.weights(self.n)))
        theta = np.concatenate([weights, self._param("u_max")])
        if cost.kappa > 0 and self.problem.wrench is not None:
            theta = np.concatenate([theta, self.params.take("wrench", 6)])
        return theta

    def _pairs(self) -> Index:
        knots = self.layout.knots()
        return np.hstack([knots[:-1], knots[1:], self._steps(self.count)])

    def _about_knots(self) -> Index:
        """(q⁻, q, q⁺, h, û⁻, û) of the inner knots."""
        knots, torques = self.layout.knots(), self.layout.torques()
        near = [knots[:-2], knots[1:-1], knots[2:], self._steps(self.count - 1)]
        return np.hstack([*near, torques[:-1], torques[1:]])

    def _by_knot(self, name: str, limit: str) -> Index:
        """A limit and the weights of the inner knots, one column each."""
        weights = self.params.take(name, self.count - 1, self.n * self.n)
        shared = np.tile(self._param(limit), (self.count - 1, 1))
        return np.hstack([shared, weights]).T

    def _velocity(self) -> None:
        """Velocities of the inner knots."""
        place = self.rows.take("velocity", self.count - 1, self.n)
        theta = self._by_knot("velocity_weights", "v_max")
        self._add(limits.velocity_stage(self.n), self._about_knots(), theta, place)

    def _acceleration(self) -> None:
        """Accelerations of all intervals."""
        place = self.rows.take("acceleration", self.count, self.n)
        theta = self._by_knot("acceleration_weights", "a_max")
        self._add(limits.acceleration_stage(self.n), self._about_knots(), theta, place[1:])
        stage, ends = limits.first_acceleration_stage(self.n), self._param("a_max", "v_start")
        self._add(stage, self._pairs()[:1], ends, place[:1])

    def _half_spaces(self, capacity: int) -> None:
        theta = self.params.take("half_spaces", self.count, 2 * self.n * capacity)
        place = self.rows.take("half_spaces", self.count, capacity)
        stage = limits.half_space_stage(self.n, capacity)
        self._add(stage, self._pairs()[:, :-1], theta.T, place)

    def _jerk(self) -> None:
        """At every knot, from and to steady motion at the ends."""
        n, torques, pairs = self.n, self.layout.torques(), self._pairs()
        place = self.rows.take("jerk", self.count + 1, n)
        inner = np.hstack([self._steps(self.count - 1), torques[:-1], torques[1:]])
        weights = self.params.take("jerk_weights", self.count - 1, n * n)
        self._add(limits.jerk_stage(n), inner, weights.T, place[1:-1])
        for at, velocity in ((0, "v_start"), (-1, "v_goal")):
            theta = self._param("j_max", velocity)
            self._add(limits.end_jerk_stage(n), pairs[[at]], theta, place[[at]])

    def _torques(self) -> None:
        if self.limits.rms_torque_nm is not None:
            place = np.tile(self.rows.take("rms_torque", 1, self.n), (self.count, 1))
            stage = limits.rms_torque_stage(self.n)
            self._add(stage, self.layout.torques(), self._param("rms_share"), place)
        if self.limits.torque_speed is not None:
            place = self.rows.take("torque_speed", self.count, self.n)
            stage, theta = limits.torque_speed_stage(self.n), self._param("stall_share", "no_load")
            self._add(stage, self.layout.intervals().T, theta, place)

    def _user_rows(self) -> None:
        n, count = self.n, self.count
        for i, constraint in enumerate(self.limits.path):
            stage = limits.path_stage(n, constraint.function)
            place = self.rows.take(f"path{i}", count, stage.num_rows)
            self._add(stage, self.layout.intervals().T, self._param("u_max"), place)
        if not self.layout.end_velocity:
            return
        last = np.concatenate(
            [self.layout.knots()[-1], [self.layout.step], self.layout.last_velocity()]
        )[None]
        none = np.zeros(0, dtype=np.int64)
        for i, condition in enumerate(self.limits.end):
            stage = limits.end_stage(n, condition.function, count)
            self._add(stage, last, none, self.rows.take(f"end{i}", 1, stage.num_rows))
        if self.limits.end_cost is not None:
            self._add(limits.end_stage(n, self.limits.end_cost.function, count), last, none, None)
