"""The only caller of `nlpsol`: one solver object per programme, many solves.

Speed and acceleration limits are rarely active at an optimum with a velocity cost, yet their rows
double the size of the linear systems. So the programme is solved without them first; what the
solution violates is added, and it is solved again from there. A solution that satisfies every
limit is an optimum of the full programme whether or not its rows were present.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import casadi as ca
import numpy as np

from dmoc.arrays import Array
from dmoc.cost import Cost
from dmoc.motion import MotionProblem
from dmoc.nlp_types import DEFAULT_PARAMS, Box, Guess, IpoptParams, NlpSolution, PathRows
from dmoc.programme import Families, MotionProgramme, motion_programme
from dmoc.state import knot_velocities, mass_matrices, residuals
from dmoc.status import Status

__all__ = ["Multipliers", "solve_nlp"]

STATUS = {
    "Solve_Succeeded": Status.CONVERGED,
    "Solved_To_Acceptable_Level": Status.ACCEPTABLE,
    "Feasible_Point_Found": Status.ACCEPTABLE,
    "Infeasible_Problem_Detected": Status.INFEASIBLE,
    "Not_Enough_Degrees_Of_Freedom": Status.INFEASIBLE,
    "Restoration_Failed": Status.INFEASIBLE,
    "Maximum_Iterations_Exceeded": Status.ITERATION_LIMIT,
    "Maximum_CpuTime_Exceeded": Status.TIME_LIMIT,
    "Maximum_WallTime_Exceeded": Status.TIME_LIMIT,
    "User_Requested_Stop": Status.TIME_LIMIT,
}
"""What Ipopt's return codes mean here; every other code is a numerical failure."""

SHORTEST_STEP_S = 1e-4
LONGEST_MOTION_S = 120.0
# A limit counts as violated beyond this share of itself.
LIMIT_SLACK = 1e-6
# Rows of momentum are divided by this time [s] times u_max.
ROW_TIME_S = 0.1

_SOLVERS: dict[tuple[Any, ...], ca.Function] = {}


@dataclass(frozen=True)
class Multipliers:
    """Dual variables of a solution: of x, of the momentum rows, and of the half-space rows."""

    bounds: Array
    rows: Array
    families: Families


def solve_nlp(
    problem: MotionProblem,
    guess: Guess,
    *,
    box: Box | None = None,
    rows: PathRows | None = None,
    params: IpoptParams = DEFAULT_PARAMS,
) -> NlpSolution:
    """The local optimum of `problem` next to `guess`, inside `box` and the half-spaces `rows`.

    The knots q_1..q_m and q_{N−m}..q_{N−1} of `depart_rad` and `arrive_rad` are fixed. Failure is
    a status; the last iterate is returned with it.
    """
    kept = None if rows is None else _presolved(problem, box, rows)
    capacity = 0 if kept is None else _capacity(problem, kept)
    families = Families(half_spaces=capacity)
    iterations = 0
    while True:
        solution, violated = _solve_once(problem, guess, box, kept, params, families)
        iterations += solution.iterations
        wider = replace(
            families,
            velocity=families.velocity or violated["velocity"],
            acceleration=families.acceleration or violated["acceleration"],
        )
        if wider == families or not solution.status.ok:
            return replace(solution, iterations=iterations)
        families = wider
        guess = Guess(solution.q_rad, solution.torque_nm, solution.step_s)


def _solve_once(
    problem: MotionProblem,
    guess: Guess,
    box: Box | None,
    rows: PathRows | None,
    params: IpoptParams,
    families: Families,
) -> tuple[NlpSolution, dict[str, bool]]:
    motion = motion_programme(problem, families)
    layout, robot = motion.layout, problem.robot
    warm = isinstance(guess.multipliers, Multipliers) and guess.multipliers.families == families
    solver = _solver(motion, params, warm)
    half, lower_half = _half_space_params(problem, rows, families.half_spaces)
    p = motion.pack(
        scale=1.0 / (ROW_TIME_S * robot.torque_limit_nm), u_max=robot.torque_limit_nm,
        weights=_weights(problem), smoothing=problem.cost.torque_smoothing,
        v_max=robot.velocity_limit_rad_s, a_max=robot.acceleration_limit_rad_s2,
        v_start=problem.start_velocity_rad_s, v_goal=problem.goal_velocity_rad_s,
        half_spaces=half,
    )  # fmt: skip
    lbx, ubx = _variable_bounds(problem, motion, box)
    lbg, ubg = _row_bounds(problem, motion, lower_half)
    u0 = guess.torque_nm / robot.torque_limit_nm
    x0 = np.clip(layout.pack(guess.q_rad, u0, guess.step_s), lbx, ubx)
    arguments = {"x0": x0, "p": p, "lbx": lbx, "ubx": ubx, "lbg": lbg, "ubg": ubg}
    if warm:
        arguments |= {"lam_x0": guess.multipliers.bounds, "lam_g0": guess.multipliers.rows}
    result = solver(**arguments)
    stats = solver.stats()
    x = np.array(result["x"]).ravel()
    status = STATUS.get(stats["return_status"], Status.NUMERICAL_FAILURE)
    if not np.all(np.isfinite(x)):
        status, x = Status.NUMERICAL_FAILURE, x0
    q, u, h = x[layout.knots()], x[layout.torques()], float(x[layout.step])
    torque = u * robot.torque_limit_nm
    smoothing = problem.cost.torque_smoothing * float(np.sum(np.diff(u, axis=0) ** 2))
    left, right = residuals(problem, q, torque, h)
    solution = NlpSolution(
        status=status, q_rad=q, torque_nm=torque, step_s=h,
        velocity_rad_s=knot_velocities(robot, q, left, right),
        cost=float(result["f"]) - smoothing, smoothing_cost=smoothing,
        iterations=int(stats["iter_count"]),
        max_defect=_max_defect(problem, left, right, h),
        multipliers=Multipliers(
            np.array(result["lam_x"]).ravel(), np.array(result["lam_g"]).ravel(), families
        ),
    )  # fmt: skip
    return solution, _violations(problem, q, h)


def _solver(motion: MotionProgramme, params: IpoptParams, warm: bool) -> ca.Function:
    key = (motion.key, params, warm)
    if key not in _SOLVERS:
        programme = motion.programme
        options = {
            "print_time": False, "no_nlp_grad": True, "calc_lam_p": False,
            "grad_f": programme.grad_f, "jac_g": programme.jac_g, "hess_lag": programme.hess_lag,
            "ipopt.print_level": 0, "ipopt.sb": "yes", "ipopt.nlp_scaling_method": "none",
            "ipopt.mu_strategy": "adaptive", "ipopt.mu_oracle": "probing",
            "ipopt.tol": params.tolerance, "ipopt.constr_viol_tol": 1e-8,
            "ipopt.acceptable_tol": params.acceptable_tolerance,
            "ipopt.acceptable_iter": params.acceptable_iterations,
            "ipopt.max_iter": params.max_iterations,
        }  # fmt: skip
        if warm:
            options |= {
                "ipopt.warm_start_init_point": "yes", "ipopt.mu_strategy": "monotone",
                "ipopt.mu_init": 1e-6, "ipopt.warm_start_bound_push": 1e-8,
                "ipopt.warm_start_mult_bound_push": 1e-8,
            }  # fmt: skip
        _SOLVERS[key] = ca.nlpsol("motion", params.solver, programme.nlp, options)
    return _SOLVERS[key]


def _weights(problem: MotionProblem) -> tuple[float, float, float]:
    cost = problem.cost
    price = cost.effort if isinstance(cost, Cost) else cost.energy
    return cost.time, price, cost.velocity


def _variable_bounds(
    problem: MotionProblem, motion: MotionProgramme, box: Box | None
) -> tuple[Array, Array]:
    robot, layout, count = problem.robot, motion.layout, problem.num_intervals
    lower = np.broadcast_to(robot.q_lower_rad, (count + 1, robot.num_joints)).copy()
    upper = np.broadcast_to(robot.q_upper_rad, (count + 1, robot.num_joints)).copy()
    if box is not None:
        lower, upper = np.maximum(lower, box.q_lower_rad), np.minimum(upper, box.q_upper_rad)
    for index, value in _fixed_knots(problem):
        lower[index] = upper[index] = value
    h = (SHORTEST_STEP_S, LONGEST_MOTION_S / count)
    if problem.duration_s is not None:
        h = (problem.duration_s / count,) * 2
    one = np.ones((count, robot.num_joints))
    return layout.pack(lower, -one, h[0]), layout.pack(upper, one, h[1])


def _fixed_knots(problem: MotionProblem) -> list[tuple[Any, Array]]:
    fixed = [(0, problem.start_rad), (-1, problem.goal_rad)]
    if problem.depart_rad is not None:
        fixed.append((slice(1, len(problem.depart_rad) + 1), problem.depart_rad))
    if problem.arrive_rad is not None:
        fixed.append((slice(-1 - len(problem.arrive_rad), -1), problem.arrive_rad))
    return fixed


def _row_bounds(
    problem: MotionProblem, motion: MotionProgramme, lower_half: Array
) -> tuple[Array, Array]:
    """Momentum rows are equations whose right-hand side holds the end momenta."""
    size = motion.programme.num_rows
    lower, upper = -np.ones(size), np.ones(size)
    momentum = motion.rows["momentum"]
    lower[momentum] = upper[momentum] = 0.0
    scale = 1.0 / (ROW_TIME_S * problem.robot.torque_limit_nm)
    for at, sign, q, v in (
        (0, -1.0, problem.start_rad, problem.start_velocity_rad_s),
        (-1, 1.0, problem.goal_rad, problem.goal_velocity_rad_s),
    ):
        if np.any(v):
            p = sign * scale * (mass_matrices(problem.robot, q[None])[0] @ v)
            lower[momentum[at]] = upper[momentum[at]] = p
    if "half_spaces" in motion.rows:
        place = motion.rows["half_spaces"]
        lower[place], upper[place] = lower_half, np.inf
    return lower, upper


def _presolved(problem: MotionProblem, box: Box | None, rows: PathRows) -> PathRows:
    """Without the rows that no point of the bounds can violate."""
    robot = problem.robot
    shape = (problem.num_intervals + 1, robot.num_joints)
    lower, upper = (np.broadcast_to(b, shape) for b in (robot.q_lower_rad, robot.q_upper_rad))
    if box is not None:
        lower, upper = np.maximum(lower, box.q_lower_rad), np.minimum(upper, box.q_upper_rad)
    i, share, g = rows.interval, rows.fraction[:, None], rows.gradient
    low = (1 - share) * lower[i] + share * lower[i + 1]
    high = (1 - share) * upper[i] + share * upper[i + 1]
    worst = np.sum(np.minimum(g * low, g * high), axis=1)
    keep = worst < rows.lower
    return PathRows(i[keep], rows.fraction[keep], g[keep], rows.lower[keep])


def _capacity(problem: MotionProblem, rows: PathRows) -> int:
    """Rows per interval, rounded up so that few solver objects serve all."""
    if len(rows.interval) == 0:
        return 0
    most = int(np.max(np.bincount(rows.interval, minlength=problem.num_intervals)))
    return -(-most // 8) * 8


def _half_space_params(
    problem: MotionProblem, rows: PathRows | None, capacity: int
) -> tuple[Array, Array]:
    """Coefficients (N, 2 n capacity) and lower bounds (N, capacity); unused rows are free."""
    count, n = problem.num_intervals, problem.robot.num_joints
    coefficients = np.zeros((count, 2, capacity, n))
    lower = np.full((count, capacity), -np.inf)
    if rows is not None and capacity:
        used = np.zeros(count, dtype=np.int64)
        for i, share, gradient, bound in zip(
            rows.interval, rows.fraction, rows.gradient, rows.lower
        ):
            slot = used[i]
            coefficients[i, 0, slot] = (1 - share) * gradient
            coefficients[i, 1, slot] = share * gradient
            lower[i, slot] = bound
            used[i] += 1
    return coefficients.reshape(count, -1), lower


def _max_defect(problem: MotionProblem, left: Array, right: Array, h: float) -> float:
    """Largest momentum residual as a fraction of h u_max, from q, u, h alone."""
    robot = problem.robot
    ends = mass_matrices(robot, np.stack([problem.start_rad, problem.goal_rad]))
    first = ends[0] @ problem.start_velocity_rad_s + left[0]
    last = -(ends[1] @ problem.goal_velocity_rad_s) + right[-1]
    rows = np.vstack([first, left[1:] + right[:-1], last])
    return float(np.max(np.abs(rows) / (h * robot.torque_limit_nm)))


def _violations(problem: MotionProblem, q: Array, h: float) -> dict[str, bool]:
    """Which families of limits a solution breaks."""
    robot, most = problem.robot, 1.0 + LIMIT_SLACK
    v = np.diff(q, axis=0) / h
    ends = np.vstack(
        [2 * (v[0] - problem.start_velocity_rad_s), 2 * (problem.goal_velocity_rad_s - v[-1])]
    )
    a = np.vstack([np.diff(v, axis=0), ends]) / h
    return {
        "velocity": bool(np.any(np.abs(v) > most * robot.velocity_limit_rad_s)),
        "acceleration": bool(np.any(np.abs(a) > most * robot.acceleration_limit_rad_s2)),
    }
