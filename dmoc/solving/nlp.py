"""One programme of a motion solved, by a solver of the registry, with limits only where they bind.

Speed and acceleration limits are often inactive at an optimum with a velocity cost, yet their rows
double the size of the linear systems. So a programme is solved without them first; what the
solution violates is added, and it is solved again from there. A solution that satisfies every
limit is an optimum of the full programme whether or not its rows were present.
"""

from __future__ import annotations

import threading
from dataclasses import dataclass, replace

import numpy as np

from dmoc.arrays import Array
from dmoc.motion.motion import MotionProblem
from dmoc.motion.status import Status
from dmoc.physics.state import knot_velocities, max_defect, residuals
from dmoc.programme.builder import Families, motion_programme
from dmoc.programme.curve_limits import (
    CURVE_SLACK,
    POSITION_SLACK_RAD,
    Curve,
    Lag,
    Margins,
    curve_of,
    excess_of,
    jerk_of,
    lag_of,
    mean_curve_of,
    mobility_of,
    moved_inside,
    no_lag,
    no_margins,
)
from dmoc.programme.numbers import (
    capacity_for,
    half_space_params,
    parameters,
    row_bounds,
    variable_bounds,
    without_idle_rows,
)
from dmoc.programme.types import Box, Guess, NlpSolution, PathRows
from dmoc.solving.solvers import DEFAULT_PARAMS, STATUS, SolveParams, minimum

# A motion whose equations hold less well than this (fraction of h u_max) is not called converged.
LARGEST_DEFECT = 1e-6

# MUMPS and CasADi's graph are not safe for threads; processes are the way to use more cores.
ONE_AT_A_TIME = threading.RLock()


@dataclass(frozen=True)
class Multipliers:
    """Dual variables of a solution: of the bounds of x and of all rows of `families`.

    `lag` is what its rows of speed and acceleration are short of, where it has any.
    """

    bounds: Array
    rows: Array
    families: Families
    lag: Lag | None = None


def solve_nlp(
    problem: MotionProblem,
    guess: Guess,
    *,
    box: Box | None = None,
    rows: PathRows | None = None,
    params: SolveParams = DEFAULT_PARAMS,
    families: Families | None = None,
) -> NlpSolution:
    """The local optimum of `problem` next to `guess`, inside `box` and the half-spaces `rows`.

    The knots q_1..q_m and q_{N−m}..q_{N−1} of `depart_rad` and `arrive_rad` are fixed. `families`
    names the limits whose rows are there from the start (default: those of the guess's
    multipliers, else none); others join when a solution violates them. Failure is a status; the
    last iterate comes with it.
    """
    with ONE_AT_A_TIME:
        return _with_lazy_limits(problem, guess, box, rows, params, families)


def _with_lazy_limits(
    problem: MotionProblem,
    guess: Guess,
    box: Box | None,
    rows: PathRows | None,
    params: SolveParams,
    families: Families | None,
) -> NlpSolution:
    kept = None if rows is None else without_idle_rows(problem, box, rows)
    warm = guess.multipliers if isinstance(guess.multipliers, Multipliers) else None
    if families is None:
        families = Families() if warm is None else warm.families
    families = replace(families, half_spaces=0 if kept is None else capacity_for(kept))
    lag = None if warm is None else warm.lag
    if lag is None:
        lag = no_lag(problem.num_intervals, problem.robot.num_joints)
    margins = no_margins(lag)
    exact, iterations, corrections = params.limit_curve, 0, 0
    slack = CURVE_SLACK if exact else 0.0
    no_mobility = np.zeros((len(lag.velocity), problem.robot.num_joints, problem.robot.num_joints))
    while True:
        if families.limited or problem.jerk_limit_rad_s3 is not None:
            mobility = mobility_of(problem.robot, guess.q_rad) if exact else no_mobility
            margins = replace(margins, mobility=mobility)
        solution = _solve_once(problem, guess, box, kept, params, families, margins)
        iterations += solution.iterations
        if solution.status is Status.INFEASIBLE:
            break
        curve = _curve(problem, solution, exact)
        too_fast, too_hard = curve.breaks_velocity(slack), curve.breaks_acceleration(slack)
        too_far = _excess(problem, solution)
        jerk = jerk_of(problem, solution.velocity_rad_s, solution.step_s)
        too_rough = exact and bool(np.abs(jerk).max() > 1.0 + slack)
        leaves = exact and bool(too_far.max() > POSITION_SLACK_RAD)
        wider = replace(
            families,
            velocity=families.velocity or too_fast,
            acceleration=families.acceleration or too_hard,
        )
        if wider == families:
            most = params.curve_corrections if exact else 0
            broken = too_fast or too_hard or leaves or too_rough
            if not (solution.status.ok and broken) or corrections == most:
                break
            corrections += 1
            if corrections > 1:  # a better lag alone did not do
                margins = margins.corrected(curve)
        if too_rough and solution.status.ok and corrections > 1:
            margins = margins.smoothed(jerk)
        if leaves and solution.status.ok:
            margins = replace(margins, inside=moved_inside(margins.inside, too_far))
        if solution.status.ok:
            lag = _lag(problem, solution) if exact else lag
            if wider != families:
                lag = lag.tempered(curve)
            margins = replace(margins, lag=lag)
            carried = None
            if solution.multipliers is not None:
                carried = _carried(problem, solution.multipliers, wider, lag)
            guess = Guess(solution.q_rad, solution.torque_nm, solution.step_s, carried)
        families = wider
    if families.limited and solution.status.ok and solution.multipliers is not None:
        known = replace(
            solution.multipliers,
            lag=_lag(problem, solution).tempered(_curve(problem, solution, True)),
        )
        solution = replace(solution, multipliers=known)
    return replace(solution, iterations=iterations)


def _curve(problem: MotionProblem, solution: NlpSolution, exact: bool) -> Curve:
    if exact:
        return curve_of(problem.robot, solution.q_rad, solution.velocity_rad_s, solution.step_s)
    return mean_curve_of(problem, solution.q_rad, solution.step_s)


def _excess(problem: MotionProblem, solution: NlpSolution) -> Array:
    return excess_of(problem.robot, solution.q_rad, solution.velocity_rad_s, solution.step_s)


def _lag(problem: MotionProblem, solution: NlpSolution) -> Lag:
    """What rows with the inertia of this solution are short of."""
    return lag_of(
        problem,
        _curve(problem, solution, True),
        solution.q_rad,
        solution.velocity_rad_s,
        solution.torque_nm,
        solution.step_s,
        mobility_of(problem.robot, solution.q_rad),
    )


def _carried(
    problem: MotionProblem, known: Multipliers, families: Families, lag: Lag
) -> Multipliers:
    """Multipliers for a programme with more families of rows; what is new starts at zero."""
    source, target = motion_programme(problem, known.families), motion_programme(problem, families)
    rows = np.zeros(target.programme.num_rows)
    for name, place in source.rows.items():
        rows[target.rows[name]] = known.rows[place]
    return Multipliers(known.bounds, rows, families, lag)


def _solve_once(
    problem: MotionProblem,
    guess: Guess,
    box: Box | None,
    rows: PathRows | None,
    params: SolveParams,
    families: Families,
    margins: Margins,
) -> NlpSolution:
    motion = motion_programme(problem, families)
    layout, robot = motion.layout, problem.robot
    half, lower_half = half_space_params(problem, rows, families.half_spaces)
    lbx, ubx = variable_bounds(problem, motion, box, margins.inside)
    lbg, ubg = row_bounds(problem, motion, lower_half, margins)
    if np.any(lbx > ubx) or np.any(lbg > ubg):
        return _hopeless(problem, guess, families)
    x0 = layout.pack(guess.q_rad, guess.torque_nm / robot.torque_limit_nm, guess.step_s)
    arguments = {
        "x0": np.clip(x0, lbx, ubx),
        "lbx": lbx,
        "ubx": ubx,
        "lbg": lbg,
        "ubg": ubg,
        "p": parameters(problem, motion, half, margins),
    }
    multipliers = guess.multipliers
    warm = (
        isinstance(multipliers, Multipliers)
        and multipliers.families == families
        and (len(multipliers.bounds), len(multipliers.rows)) == (layout.size, len(lbg))
    )
    if warm:
        arguments |= {"lam_x0": multipliers.bounds, "lam_g0": multipliers.rows}
    result, stats = minimum(motion, arguments, params, warm)
    x = np.array(result["x"]).ravel()
    status = STATUS.get(stats["return_status"], Status.NUMERICAL_FAILURE)
    cost = float(result["f"])
    if not (np.all(np.isfinite(x)) and np.isfinite(cost)):
        status, x = Status.NUMERICAL_FAILURE, arguments["x0"]
    elif problem.cost.reported_kappa != problem.cost.kappa:
        p = arguments["p"].copy()
        p[motion.params["weights"][-1]] = problem.cost.reported_kappa
        cost = float(motion.programme.nlp(x, p)[0])
    q, u, h = x[layout.knots()], x[layout.torques()], float(x[layout.step])
    torque = u * robot.torque_limit_nm
    smoothing = problem.cost.smoothing * float(np.sum(np.diff(u, axis=0) ** 2))
    left, right = residuals(problem, q, torque, h)
    defect = max_defect(problem, q, left, right, h)
    if status is Status.CONVERGED and defect > LARGEST_DEFECT:
        status = Status.ACCEPTABLE
    return NlpSolution(
        status=status,
        q_rad=q,
        torque_nm=torque,
        step_s=h,
        velocity_rad_s=knot_velocities(robot, q, left, right),
        cost=cost - smoothing,
        smoothing_cost=smoothing,
        iterations=int(stats["iter_count"]),
        max_defect=defect,
        solver=stats["solver"],
        multipliers=Multipliers(
            np.array(result["lam_x"]).ravel(), np.array(result["lam_g"]).ravel(), families
        ),
    )


def _hopeless(problem: MotionProblem, guess: Guess, families: Families) -> NlpSolution:
    """What a box or rows without any point inside come to: the guess, called infeasible."""
    q, h = guess.q_rad, guess.step_s
    left, right = residuals(problem, q, guess.torque_nm, h)
    return NlpSolution(
        status=Status.INFEASIBLE,
        q_rad=q,
        torque_nm=guess.torque_nm,
        step_s=h,
        velocity_rad_s=knot_velocities(problem.robot, q, left, right),
        cost=float("inf"),
        smoothing_cost=0.0,
        iterations=0,
        max_defect=max_defect(problem, q, left, right, h),
        multipliers=None,
    )
