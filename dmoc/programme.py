"""The programme of a motion: which stages, which rows, where each parameter goes.

A programme depends on the arm, the kind of cost, N and the families of rows it carries; boundary
states, limits, weights, boxes and half-spaces are parameters and bounds of it. Programmes are kept
for the life of the process.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from dmoc.backend import Backend, StageSet
from dmoc.cost import Cost
from dmoc.drive import drive_from_mapping
from dmoc.dynamics import ArmModel, arm_model
from dmoc.limits import (
    acceleration_stage,
    end_acceleration_stage,
    half_space_stage,
    smoothing_stage,
    velocity_stage,
)
from dmoc.motion import MotionProblem
from dmoc.robot import Robot
from dmoc.stages import Stage, dynamics_stage, electrical_stage, quadratic_stage
from dmoc.transcription import Block, Index, Layout, Programme, assemble

__all__ = ["Families", "MotionProgramme", "arm_of", "motion_programme"]

_ARMS: dict[str, ArmModel] = {}
_STAGES: dict[tuple[Any, ...], StageSet] = {}
_PROGRAMMES: dict[tuple[Any, ...], MotionProgramme] = {}


@dataclass(frozen=True)
class Families:
    """Which optional rows a programme carries; `half_spaces` is their number per interval."""

    velocity: bool = False
    acceleration: bool = False
    half_spaces: int = 0


@dataclass(frozen=True)
class MotionProgramme:
    """A programme with the places of its parameters (`params`) and rows (`rows`)."""

    programme: Programme
    layout: Layout
    params: dict[str, Index]
    rows: dict[str, Index]
    key: tuple[Any, ...]

    def pack(self, **values: Any) -> np.ndarray:
        """The parameter vector; names that the programme does not carry are left out."""
        p = np.zeros(self.programme.num_params)
        for name, index in self.params.items():
            p[index] = values[name]
        return p


def arm_of(robot: Robot) -> ArmModel:
    """The numbers of the robot's dynamics, kept per fingerprint."""
    if robot.fingerprint not in _ARMS:
        _ARMS[robot.fingerprint] = arm_model(robot.model)
    return _ARMS[robot.fingerprint]


def motion_programme(problem: MotionProblem, families: Families) -> MotionProgramme:
    """The programme for `problem` with `families` of rows, built once per process and backend."""
    robot = problem.robot
    kind = type(problem.cost).__name__
    drive = "" if kind == "Cost" else repr(sorted(robot.drive.items()))
    physics = (robot.fingerprint, kind, drive)
    if physics not in _STAGES:
        _STAGES[physics] = StageSet((dynamics_stage(arm_of(robot), False), _cost_stage(problem)))
    backend = _STAGES[physics].current()
    key = (*physics, backend.name, problem.num_intervals, families)
    if key not in _PROGRAMMES:
        _PROGRAMMES[key] = _build(problem, backend, families, key)
    return _PROGRAMMES[key]


def _cost_stage(problem: MotionProblem) -> Stage:
    n = problem.robot.num_joints
    if isinstance(problem.cost, Cost):
        return quadratic_stage(n)
    return electrical_stage(n, drive_from_mapping(problem.robot.drive, n))


class _Counter:
    """Hands out consecutive positions by name."""

    def __init__(self) -> None:
        self.places: dict[str, Index] = {}
        self.size = 0

    def take(self, name: str, *shape: int) -> Index:
        count = int(np.prod(shape))
        index = np.arange(self.size, self.size + count).reshape(shape)
        self.places[name], self.size = index, self.size + count
        return index


def _build(
    problem: MotionProblem, backend: Backend, families: Families, key: tuple[Any, ...]
) -> MotionProgramme:
    n, count = problem.robot.num_joints, problem.num_intervals
    dynamics, cost = backend.stages
    layout = Layout(count, n)
    params, rows = _Counter(), _Counter()
    scale, u_max = params.take("scale", n), params.take("u_max", n)
    momentum = rows.take("momentum", count + 1, n)
    pairs = np.hstack([momentum[:-1], momentum[1:]]).T
    intervals, torques, knots = layout.intervals(), layout.torques(), layout.knots()
    blocks = [
        Block(dynamics, intervals, np.concatenate([scale, u_max]), pairs),
        Block(
            cost, intervals, np.concatenate([params.take("weights", 3), u_max]), None,
        ),
        Block(
            smoothing_stage(n), np.hstack([torques[:-1], torques[1:]]).T,
            params.take("smoothing", 1), None,
        ),
    ]  # fmt: skip
    step = np.full((count, 1), layout.step)
    ends = np.hstack([knots[:-1], knots[1:], step])
    if families.velocity:
        place = rows.take("velocity", count, n)
        blocks.append(Block(velocity_stage(n), ends.T, params.take("v_max", n), place.T))
    if families.acceleration:
        a_max = params.take("a_max", n)
        inner = np.hstack([knots[:-2], knots[1:-1], knots[2:], step[1:]])
        place = rows.take("acceleration", count + 1, n)
        blocks.append(Block(acceleration_stage(n), inner.T, a_max, place[1:-1].T))
        for name, at, k in (("v_start", 0, 0), ("v_goal", -1, -1)):
            theta = np.concatenate([a_max, params.take(name, n)])
            blocks.append(Block(end_acceleration_stage(n), ends[[k]].T, theta, place[[at]].T))
    if families.half_spaces:
        capacity = families.half_spaces
        theta = params.take("half_spaces", count, 2 * n * capacity)
        both = np.hstack([knots[:-1], knots[1:]])
        place = rows.take("half_spaces", count, capacity)
        blocks.append(Block(half_space_stage(n, capacity), both.T, theta.T, place.T))
    programme = assemble(blocks, layout.size, rows.size, params.size)
    return MotionProgramme(programme, layout, params.places, rows.places, key)
