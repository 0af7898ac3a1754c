"""`identify`: from logs of a robot to its dynamics, each number with its error and its origin."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace

import numpy as np
import numpy.typing as npt
import pinocchio as pin
from scipy.interpolate import CubicSpline

from dmoc.arrays import Array
from dmoc.errors import Fault, InputError, ProblemError
from dmoc.identification.consistent import (
    Compressed,
    ConsistentFit,
    fit_consistent,
    friction_first,
    link_numbers,
    pseudo_inertia,
    repaired,
    weighted_least_squares,
)
from dmoc.identification.samples import MotionLog, Samples, samples_of
from dmoc.identification.suspicion import Hypothesis, hypotheses, suspicions
from dmoc.identification.terms import GasSpring, TermColumns, couplings_of
from dmoc.robot.drive import heavy_class_drive
from dmoc.robot.robot import Robot

#: A number counts as measured where this many standard deviations are less than half of it: two,
#: and half as much again, because separate logs of one robot differ by that much more.
MEASURED_SIGMAS = 3.0
#: Shifts between torque and position that are tried [s], and the largest that is put right.
_SHIFTS_S = np.arange(-50, 51, 2) * 1e-3
_MOST_SHIFT_S = 0.01
#: A hypothesis names the cause where it leaves less than this share of the objective.
_EXPLAINS = 0.8
_LEAST_MOVING = 50


@dataclass(frozen=True, eq=False)
class IdentificationProblem:
    """Logs of one robot: `logs` to fit, `held` to judge.

    `motor_from_joint` (n, n) has off-diagonal entries where a wrist is coupled. `payload_kg` at
    `payload_com_m` in the flange frame is known and stays out of the fit. `weight` ties the links
    to the robot file; it matters little over three decades.
    """

    robot: Robot
    logs: tuple[MotionLog, ...]
    held: tuple[MotionLog, ...] = ()
    springs: tuple[GasSpring, ...] = ()
    motor_from_joint: Array | None = None
    payload_kg: float = 0.0
    payload_com_m: tuple[float, float, float] = (0.0, 0.0, 0.0)
    weight: float = 10.0
    cutoff_hz: float = 10.0

    def __post_init__(self) -> None:
        n = self.layout.num_joints
        for log in (*self.logs, *self.held):
            if log.q_rad.shape[1] != n or log.torque_nm.shape != log.q_rad.shape:
                value = f"{log.q_rad.shape[1]} joints, {log.torque_nm.shape[1]} torques"
                legal = f"{n} of each, as {self.robot.name}"
                fix = "record every joint of this robot"
                raise InputError.of("log-columns", log.name, "joints", value, legal, fix)
        if not self.logs or not self.weight > 0 or not self.cutoff_hz > 0 or self.payload_kg < 0:
            value = f"{len(self.logs)} logs, weight {self.weight}, cut-off {self.cutoff_hz} Hz"
            legal = "at least one log, weight > 0, cut-off > 0 Hz, payload >= 0 kg"
            fix = "give a log to fit"
            raise ProblemError.of("identification", "", "problem", value, legal, fix)

    @property
    def layout(self) -> TermColumns:
        """The columns of this robot."""
        n = self.robot.num_joints
        ratio = np.eye(n) if self.motor_from_joint is None else np.asarray(self.motor_from_joint)
        return TermColumns(self.robot.model, couplings_of(ratio), self.springs)

    @property
    def prior(self) -> Array:
        """What the robot file says, in the columns of the layout; bodies repaired if impossible."""
        robot, layout = self.robot, self.layout
        out = np.zeros(layout.size)
        bodies = [robot.model.inertias[i] for i in range(1, robot.model.njoints)]
        links = [pin.Inertia(b).toDynamicParameters() for b in bodies]
        repair = [link_numbers(repaired(pseudo_inertia(pi))) for pi in links]
        out[: layout.num_links] = np.concatenate(repair)
        out[layout.block("armature")] = robot.armature_kg_m2
        out[layout.block("springs")] = [spring.scale for spring in self.springs]
        return out

    @property
    def load(self) -> Array:
        """The known payload on the last joint, in the columns of the layout."""
        robot, layout = self.robot, self.layout
        place = robot.model.frames[robot.flange_id].placement
        point = pin.Inertia(self.payload_kg, np.array(self.payload_com_m), np.zeros((3, 3)))
        out = np.zeros(layout.size)
        out[: layout.num_links][-10:] = place.act(point).toDynamicParameters()
        return out


@dataclass(frozen=True)
class RunScore:
    """One run: per joint the misfit while moving, and the positive mechanical energy."""

    name: str
    seconds: float
    rel_percent: tuple[float, ...]
    rms_nm: tuple[float, ...]
    energy_j: float
    energy_percent: float
    assumed_energy_percent: float

    @property
    def mean_percent(self) -> float:
        """Mean over the joints that moved."""
        return float(np.nanmean(self.rel_percent))


@dataclass(frozen=True, eq=False)
class Identification:
    """What the logs say. `status` is `identified`, `poor` (`warnings` say what to drive)
    or `faulty`.

    `parameters` and `std` (size,) follow `layout`; `scores` are of held-out runs, or of the fitted
    ones where none was held out (`held_out` says which). `covered` has the largest |q̇|, |q̈| and
    |τ| of each joint. `measured` (size,) is where the numbers may be called so. `faults` are sure,
    `warnings` are doubts, `unidentifiable` is what free motion cannot tell.
    """

    problem: IdentificationProblem
    layout: TermColumns
    parameters: Array
    std: Array
    prior: Array
    measured: npt.NDArray[np.bool_]
    scores: tuple[RunScore, ...]
    held_out: bool
    covered: Mapping[str, Array]
    delay_s: float
    iterations: int
    objective: float
    status: str
    faults: tuple[Fault, ...] = ()
    warnings: tuple[Fault, ...] = ()
    unidentifiable: tuple[str, ...] = field(
        default=(
            "a constant factor on all torques (gear ratio or torque constant): needs a known "
            "payload, a torque sensor or the DC power",
            "a small offset of a joint's zero: needs geometric calibration",
        )
    )

    def torque_nm(self, samples: Samples) -> Array:
        """Predicted torque (M, n), the known payload included."""
        return self.layout.regressor(samples) @ (self.parameters + self.problem.load)

    def named(self, block: str) -> Array:
        """The numbers of one block of the layout."""
        return self.parameters[self.layout.block(block)]


def identify(problem: IdentificationProblem) -> Identification:
    """Friction first, then links that stay bodies; then what is doubtful about the result."""
    layout = problem.layout
    raw = [samples_of(log, problem.cutoff_hz) for log in problem.logs]
    still = _still(problem, raw)
    matrices = [layout.regressor(run) for run in raw]
    delay, runs, doubts = _delay(problem, raw, matrices, still)
    prior = problem.prior
    data, load = _data(problem, runs, matrices)
    parameters, sigma = weighted_least_squares(data)
    fitted = _fit(problem, layout, data, sigma, prior)
    residuals = [
        (run.torque_nm - m @ (fitted.parameters + load)) / sigma * run.moving
        for run, m in zip(runs, matrices)
    ]
    memory = _memory(residuals)
    start = friction_first(data, sigma, layout, prior)
    noise = np.maximum(data.residual(fitted.parameters), 1e-7 * sigma)
    wide = noise / np.maximum(sigma, 1e-300)
    fit = fit_consistent(data, sigma, layout, prior, start, problem.weight, memory * wide**2)
    values, std = fit.parameters, np.sqrt(np.diag(fit.covariance))
    objective, free = _misfit(data, values, sigma), _misfit(data, parameters, sigma)
    found = suspicions(problem.robot, layout, values, prior, objective / max(free, 1e-300), still)
    faults = list(doubts)
    if found:
        cause = _cause(problem, runs, sigma, prior, objective)
        faults += [cause] if cause else []
    poor = len(still) > 0
    status = "faulty" if faults else "poor" if poor else "identified"
    measured = (MEASURED_SIGMAS * std < 0.5 * np.abs(values)) & (status == "identified")
    result = Identification(
        problem=problem,
        layout=layout,
        parameters=values,
        std=std,
        prior=prior,
        measured=measured,
        scores=(),
        held_out=bool(problem.held),
        covered=_covered(runs),
        delay_s=delay,
        iterations=fit.iterations,
        objective=objective,
        status=status,
        faults=tuple(faults),
        warnings=(*still, *found),
    )
    judged = [samples_of(log, problem.cutoff_hz, delay) for log in problem.held]
    return replace(result, scores=tuple(score(result, run) for run in judged or runs))


def score(result: Identification, run: Samples) -> RunScore:
    """How well a run is predicted; the assumed class of friction is judged beside it."""
    tau, moving, matrix = run.torque_nm, run.moving, result.layout.regressor(run)
    predicted = matrix @ (result.parameters + result.problem.load)
    assumed = result.prior + result.problem.load
    n = result.layout.num_joints
    drive = heavy_class_drive(n)
    assumed[result.layout.block("coulomb")] = drive.coulomb_nm
    assumed[result.layout.block("viscous")] = drive.viscous_nm_s
    assumed[result.layout.block("springs")] = 0.0
    count = np.maximum(moving.sum(axis=0), 1.0)
    miss = np.sqrt((moving * (tau - predicted) ** 2).sum(axis=0) / count)
    size = np.sqrt((moving * tau**2).sum(axis=0) / count)
    with np.errstate(invalid="ignore", divide="ignore"):
        rel = np.where(moving.sum(axis=0) > 1, 100.0 * miss / size, np.nan)

    def energy(torque: Array) -> float:
        power = (torque * run.velocity_rad_s).sum(axis=1)
        return float(np.maximum(power, 0.0).sum() * run.step_s)

    true = energy(tau)
    off = [
        100.0 * (energy(torque) / max(true, 1e-12) - 1.0)
        for torque in (predicted, matrix @ assumed)
    ]
    seconds = len(tau) * run.step_s
    return RunScore(run.name, seconds, tuple(rel.tolist()), tuple(miss.tolist()), true, *off)


def _data(
    problem: IdentificationProblem, runs: list[Samples], matrices: list[Array]
) -> tuple[Compressed, Array]:
    load = problem.load
    tau = np.vstack([run.torque_nm - m @ load for run, m in zip(runs, matrices)])
    moving = np.vstack([run.moving for run in runs])
    return Compressed.of(np.concatenate(matrices), tau, moving), load


def _fit(
    problem: IdentificationProblem,
    layout: TermColumns,
    data: Compressed,
    sigma: Array,
    prior: Array,
    most: int = 200,
) -> ConsistentFit:
    start = friction_first(data, sigma, layout, prior)
    memory = np.ones(layout.num_joints)
    return fit_consistent(data, sigma, layout, prior, start, problem.weight, memory, most)


def _misfit(data: Compressed, parameters: Array, sigma: Array) -> float:
    return float(np.sum(data.counts * (data.residual(parameters) / sigma) ** 2))


def _still(problem: IdentificationProblem, runs: list[Samples]) -> tuple[Fault, ...]:
    """Joints that hardly move, each with what to drive."""
    moving = sum(run.moving.sum(axis=0) for run in runs)
    names = list(problem.robot.model.names)[1:]
    legal = f">= {_LEAST_MOVING} samples of 20 ms, both directions"
    fix = "drive this joint there and back, better all joints together (20 s of rich motion)"
    out = []
    for j, name in enumerate(names):
        speed = np.concatenate([run.velocity_rad_s[:, j] * run.moving[:, j] for run in runs])
        if moving[j] < _LEAST_MOVING or min((speed > 0).sum(), (speed < 0).sum()) < 10:
            value = f"{int(moving[j])} moving samples"
            out.append(Fault("identify-still", "", name, value, legal, fix))
    return tuple(out)


def _delay(
    problem: IdentificationProblem,
    raw: list[Samples],
    matrices: list[Array],
    still: tuple[Fault, ...],
) -> tuple[float, list[Samples], tuple[Fault, ...]]:
    """The shift of the torque that fits best; a small one is put right, a large one is a fault."""
    moving = np.vstack([run.moving for run in raw])
    if len(still) > 0 or moving.sum(axis=0).min() < 3 * problem.layout.size:
        return 0.0, raw, ()  # too few samples to tell a shift from freedom
    whole, size = np.concatenate(matrices), problem.layout.size
    stamps = [run.step_s * np.arange(len(run.torque_nm)) for run in raw]
    curves = [(CubicSpline(t, run.torque_nm), t) for t, run in zip(stamps, raw)]
    shifted = [
        np.vstack([c(np.clip(t + shift, t[0], t[-1])) for c, t in curves]) for shift in _SHIFTS_S
    ]
    left = []
    for j, rows in enumerate(moving.T > 0):
        stacked = np.column_stack([whole[rows, j], *(tau[rows, j] for tau in shifted)])
        corner = np.array(np.linalg.qr(stacked, mode="r"))[size:, size:]
        left.append((corner**2).sum(axis=0))
    table = np.array(left).T
    here = int(np.argmin(np.abs(_SHIFTS_S)))
    share = (table / np.maximum(table[here], 1e-300)).mean(axis=1)
    best = int(np.argmin(share))
    shift = float(_SHIFTS_S[best])
    if share[best] > 0.95:
        return 0.0, raw, ()
    if abs(shift) <= _MOST_SHIFT_S:
        return shift, [samples_of(log, problem.cutoff_hz, shift) for log in problem.logs], ()
    value = f"the torque fits best {1e3 * abs(shift):.0f} ms {'earlier' if shift > 0 else 'later'}"
    legal = f"at most {1e3 * _MOST_SHIFT_S:.0f} ms between position and torque"
    fix = "log both in one cycle, or filter both by the same filter"
    return shift, raw, (Fault("identify-delay", "", "torque", value, legal, fix),)


def _memory(residuals: list[Array]) -> Array:
    """Samples for one independent one: each joint's sum of autocorrelations of the residual.

    They are added in pairs of lags until a pair is negative, so a filter's ringing counts.
    """
    n = residuals[0].shape[1]
    out = np.ones(n)
    for j in range(n):
        total = np.zeros(52)
        for row in (block[:, j] for block in residuals):
            total[: len(row)] += [row[lag:] @ row[: len(row) - lag] for lag in range(len(row))[:52]]
        pairs = total.reshape(-1, 2).sum(axis=1) / max(total[0], 1e-300)
        last = int(np.argmax(np.append(pairs, -1.0) <= 0.0))
        out[j] = max(1.0, 2.0 * pairs[:last].sum() - 1.0)
    return out


def _covered(runs: list[Samples]) -> dict[str, Array]:
    names = ("velocity_rad_s", "acceleration_rad_s2", "torque_nm")
    return {
        name: np.max([np.abs(getattr(run, name)).max(axis=0) for run in runs], axis=0)
        for name in names
    }


def _cause(
    problem: IdentificationProblem,
    runs: list[Samples],
    sigma: Array,
    prior: Array,
    objective: float,
) -> Fault | None:
    """The one mistake in the log that would explain the misfit best, if any does."""

    def left(case: Hypothesis) -> float:
        layout = replace(problem.layout, model=case.model(problem.robot.model))
        changed = [case.samples(run) for run in runs]
        data, _ = _data(problem, changed, [layout.regressor(run) for run in changed])
        return _misfit(data, _fit(problem, layout, data, sigma, prior, 15).parameters, sigma)

    names = tuple(problem.robot.model.names)[1:]
    cases = hypotheses(names)
    costs = [left(case) for case in cases]
    best = int(np.argmin(costs))
    if costs[best] > _EXPLAINS * objective:
        return None
    value = f"misfit falls to {100 * costs[best] / objective:.0f} % without it"
    fix = cases[best].fix
    return Fault(cases[best].code, "", cases[best].field, value, cases[best].legal, fix)
