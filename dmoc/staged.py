"""The programme of a motion in the stage-wise form that `fatrop` needs.

Stage k has the state (q_k, p̃_k, h) and, for rows and smoothing that look back, (û_{k−1}, q_{k−1});
its controls are (w_k, û_k) with w_k = q_{k+1}. With p̃ the scaled negative momentum the discrete
Euler–Lagrange equations become explicit dynamics and one path equation per stage,

    q_{k+1} = w_k,   p̃_{k+1} = −r⁺(q_k, w_k, û_k, h),   r⁻(q_k, w_k, û_k, h) − p̃_k = 0,

so the same stage functions serve as in `dmoc.programme`; CasADi's interface to fatrop takes no
derivatives, so it differentiates them once more. The free step is carried as a state: as
one variable it would couple all stages. Rows that reach further than one knot back, sums over the
whole motion and a free last state have no place in this form.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import casadi as ca
import numpy as np

from dmoc import limits
from dmoc.arrays import Array
from dmoc.backend import Backend
from dmoc.bounds import end_momenta, knot_bounds, limit_bounds, step_bounds
from dmoc.curve_limits import Margins
from dmoc.errors import Fault, ProblemError
from dmoc.motion import MotionProblem
from dmoc.nlp_types import Box
from dmoc.programme import Builder, Families, MotionProgramme, stages_of
from dmoc.stages import Stage, expression_stage
from dmoc.transcription import Index, Layout, assemble

__all__ = ["StagedLayout", "staged_bounds", "staged_programme", "staged_structure"]

_PROGRAMMES: dict[tuple[Any, ...], MotionProgramme] = {}


@dataclass(frozen=True)
class StagedLayout(Layout):
    """Positions of the variables stage by stage: state, then controls."""

    @property
    def first_state(self) -> int:
        """Size of (q_0, p̃_0, h)."""
        return 2 * self.num_joints + 1

    @property
    def state(self) -> int:
        """Size of (q, p̃, h, û⁻, q⁻)."""
        return 4 * self.num_joints + 1

    @property
    def size(self) -> int:
        """Number of variables."""
        return int(self._starts()[-1]) + self.state

    @property
    def step(self) -> int:
        """Position of h of the first stage."""
        return 2 * self.num_joints

    def _starts(self) -> Index:
        later = self.first_state + 2 * self.num_joints
        width = self.state + 2 * self.num_joints
        return np.concatenate([[0], later + width * np.arange(self.num_intervals)])

    def _at(self, offset: int) -> Index:
        return self._starts()[:, None] + offset + np.arange(self.num_joints)

    def knots(self) -> Index:
        """(N+1, n) positions of q_k."""
        return self._at(0)

    def momenta(self) -> Index:
        """(N+1, n) positions of p̃_k."""
        return self._at(self.num_joints)

    def steps(self) -> Index:
        """(N+1, 1) positions of h."""
        return self._starts()[:, None] + 2 * self.num_joints

    def torques_before(self) -> Index:
        """(N, n) positions of û_{k−1} in the state of stage k = 1..N."""
        return self._at(2 * self.num_joints + 1)[1:]

    def knots_before(self) -> Index:
        """(N, n) positions of q_{k−1} in the state of stage k = 1..N."""
        return self._at(3 * self.num_joints + 1)[1:]

    def next_knots(self) -> Index:
        """(N, n) positions of w_k."""
        out = self._at(self.state)[:-1]
        out[0] = self.first_state + np.arange(self.num_joints)
        return out

    def torques(self) -> Index:
        """(N, n) positions of û_k."""
        return self.next_knots() + self.num_joints

    def intervals(self) -> Index:
        """(3n+1, N) positions of z = (q_k, w_k, û_k, h)."""
        parts = [self.knots()[:-1], self.next_knots(), self.torques(), self.steps()[:-1]]
        return np.hstack(parts).T

    def pack(self, q: Any, u: Any, h: float, v_end: Any = 0.0, momentum: Any = 0.0) -> Array:
        """x from knots (N+1, n), scaled torques (N, n), step and p̃ (N+1, n)."""
        x = np.empty(self.size)
        x[self.knots()], x[self.momenta()], x[self.steps()] = q, momentum, h
        x[self.torques()], x[self.torques_before()] = u, u
        x[self.next_knots()], x[self.knots_before()] = q[1:], q[:-1]
        return x


def staged_programme(problem: MotionProblem, families: Families) -> MotionProgramme:
    """The stage-wise programme of `problem`, built once per process and backend.

    Errors: `ProblemError` for what this form cannot carry.
    """
    _require_stages(problem)
    physics, stages = stages_of(problem)
    backend = Backend("vm", stages.stages)  # fatrop takes no derivatives from us
    key = (
        "staged", *physics, problem.num_intervals, problem.limits.shape, families
    )  # fmt: skip
    if key not in _PROGRAMMES:
        _PROGRAMMES[key] = _StagedBuilder(problem, backend, families).build(key)
    return _PROGRAMMES[key]


def staged_structure(motion: MotionProgramme) -> dict[str, Any]:
    """The sizes that fatrop is told: N, and per stage states, controls and other rows."""
    layout, n = motion.layout, motion.layout.num_joints
    assert isinstance(layout, StagedLayout)
    count = layout.num_intervals
    first, later = motion.rows["gaps"][:, 0], motion.rows["gaps"][:, -1] + 1
    ends = np.append(first[1:], motion.programme.num_rows)
    return {
        "N": count, "nx": [layout.first_state] + [layout.state] * count,
        "nu": [2 * n] * count + [0], "ng": [*(int(x) for x in ends - later), 0],
    }  # fmt: skip


def staged_bounds(
    problem: MotionProblem,
    motion: MotionProgramme,
    box: Box | None,
    lower_half: Array,
    margins: Margins,
) -> tuple[tuple[Array, Array], tuple[Array, Array]]:
    """Bounds of x and of all rows."""
    layout = motion.layout
    assert isinstance(layout, StagedLayout)
    q_lower, q_upper = knot_bounds(problem, box)
    lower, upper = np.full(layout.size, -np.inf), np.full(layout.size, np.inf)
    lower[layout.knots()], upper[layout.knots()] = q_lower, q_upper
    lower[layout.torques()], upper[layout.torques()] = -1.0, 1.0
    lower[layout.step], upper[layout.step] = step_bounds(problem)
    for at, momentum in zip((0, -1), end_momenta(problem)):
        lower[layout.momenta()[at]] = upper[layout.momenta()[at]] = -momentum
    rows_lower, rows_upper = (sign * np.ones(motion.programme.num_rows) for sign in (-1.0, 1.0))
    for name in ("gaps", "momentum"):
        rows_lower[motion.rows[name]] = rows_upper[motion.rows[name]] = 0.0
    limit_bounds(problem, motion, lower_half, margins, rows_lower, rows_upper)
    return (lower, upper), (rows_lower, rows_upper)


def _require_stages(problem: MotionProblem) -> None:
    limits_ = problem.limits
    unfit = {
        "jerk_rad_s3": limits_.jerk_rad_s3 is not None,
        "rms_torque_nm": limits_.rms_torque_nm is not None,
        "end": bool(limits_.end), "end_cost": limits_.end_cost is not None,
        "free_goal_velocity": limits_.free_goal_velocity,
    }  # fmt: skip
    faults = [
        Fault("solver-limits", field=f"limits.{name}", value="given",
              legal="not with solver fatrop, whose rows may look back one knot only",
              fix="use solver ipopt")
        for name, given in unfit.items() if given
    ]  # fmt: skip
    if faults:
        raise ProblemError(faults)


def _affine_stage(name: str, n: int, sign: float, pair: bool) -> Stage:
    """Rows sign·a, or sign·(a − b) for z = (a, b) with `pair`."""
    a, b = ca.SX.sym("a", n), ca.SX.sym("b", n)
    rows = sign * (a - b) if pair else sign * a
    return expression_stage(name, ca.vertcat(a, b) if pair else a, ca.SX.sym("none", 0), rows)


class _StagedBuilder(Builder):
    """Places rows stage by stage: dynamics first, then what limits the stage."""

    def __init__(self, problem: MotionProblem, backend: Backend, families: Families) -> None:
        super().__init__(problem, backend, families)
        self.layout: StagedLayout = StagedLayout(self.count, self.n)

    def build(self, key: tuple[Any, ...]) -> MotionProgramme:
        self._place_rows()
        self._dynamics()
        if self.families.velocity:
            self._velocity()
        if self.families.acceleration:
            self._acceleration()
        if self.families.half_spaces:
            self._half_spaces(self.families.half_spaces)
        self._torques()
        self._user_rows()
        programme = assemble(self.blocks, self.layout.size, self.rows.size, self.params.size)
        return MotionProgramme(
            programme, self.layout, self.params.places, self.rows.places, key, tuple(self.blocks)
        )

    def _place_rows(self) -> None:
        """Every family's rows, stage by stage, in the order in which fatrop reads them."""
        n, families = self.n, self.families
        widths = {"gaps": (4 * n + 1, 0), "momentum": (n, 0)}
        if families.velocity:
            widths["velocity"] = (n, 1)
        if families.acceleration:
            widths["acceleration"] = (n, 0)
        if families.half_spaces:
            widths["half_spaces"] = (families.half_spaces, 0)
        if self.limits.torque_speed is not None:
            widths["torque_speed"] = (n, 0)
        for i, constraint in enumerate(self.limits.path):
            widths[f"path{i}"] = (int(constraint.function.size1_out(0)), 0)
        places: dict[str, list[Index]] = {name: [] for name in widths}
        size = 0
        for k in range(self.count):
            for name, (width, begin) in widths.items():
                if k >= begin:
                    places[name].append(np.arange(size, size + width))
                    size += width
        self.rows.places = {name: np.array(rows) for name, rows in places.items()}
        self.rows.size = size

    def _dynamics(self) -> None:
        n, layout = self.n, self.layout
        gaps, momentum = self.rows.places["gaps"], self.rows.places["momentum"]
        none = np.zeros(0, dtype=np.int64)
        parts = np.split(np.arange(4 * n + 1), [n, 2 * n, 2 * n + 1, 3 * n + 1])
        q, p, h, u_before, q_before = (gaps[:, part] for part in parts)
        theta = self._param("scale", "u_max")
        if self.problem.wrench is not None:
            theta = np.concatenate([theta, self.params.take("wrench", 6)])
        dynamics, cost = self.stages
        intervals = layout.intervals().T
        self._add(dynamics, intervals, theta, np.hstack([momentum, p]))
        self._add(_affine_stage("plus", n, 1.0, False), layout.momenta()[1:], none, p)
        self._add(_affine_stage("minus", n, -1.0, False), layout.momenta()[:-1], none, momentum)
        link, one = _affine_stage("link", n, 1.0, True), _affine_stage("same", 1, 1.0, True)
        knots, steps = layout.knots(), layout.steps()
        for target, source, place in (
            (knots[1:], layout.next_knots(), q),
            (layout.torques_before(), layout.torques(), u_before),
            (layout.knots_before(), knots[:-1], q_before),
        ):
            self._add(link, np.hstack([target, source]), none, place)
        self._add(one, np.hstack([steps[1:], steps[:-1]]), none, h)
        weights = self.params.take("weights", cost.num_params - n)
        self._add(cost, intervals, np.concatenate([weights, self._param("u_max")]), None)
        pairs = np.hstack([layout.torques_before()[:-1], layout.torques()[1:]])
        self._add(limits.smoothing_stage(n), pairs, self.params.take("smoothing", 1), None)

    def _about_knots(self) -> Index:
        layout = self.layout
        now = [layout.knots_before()[:-1], layout.knots()[1:-1], layout.next_knots()[1:]]
        torques = [layout.torques_before()[:-1], layout.torques()[1:]]
        return np.hstack([*now, layout.steps()[1:-1], *torques])

    def _pairs(self) -> Index:
        layout = self.layout
        return np.hstack([layout.knots()[:-1], layout.next_knots(), layout.steps()[:-1]])
