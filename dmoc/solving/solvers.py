"""The registry of solvers: each takes one programme from a start to a local optimum.

A solver is a function with the arguments and results of CasADi's `nlpsol`; what it says of the end
is one of Ipopt's return codes. To add one, write the function and enter it in `SOLVERS`: options,
commands, result files and error messages take the name from there, and no code asks which it is.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import casadi as ca

from dmoc.arrays import Array
from dmoc.errors import ProblemError
from dmoc.motion.status import Status
from dmoc.programme.builder import MotionProgramme

#: The solver of a station's edges: Ipopt's optima in a third of the time. A bare `SolveParams()`
#: names Ipopt, which compiles nothing before its first solve.
DEFAULT_SOLVER = "structured"

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
"""What the return codes mean here; every other code is a numerical failure."""


@dataclass(frozen=True)
class SolveParams:
    """Options of a solve. `tolerance` is Ipopt's `tol` on the scaled problem.

    With `limit_curve` position, speed, acceleration and jerk limits hold on the whole executed
    curve (to 1 %, position to 1e-5 rad), else only for differences of the knots. What the curve
    does beyond its rows is known only afterwards: up to `curve_corrections` further solves take it
    in; with 0 the next warm start does.
    `solver` is a name of `SOLVERS`: `ipopt`, or `structured`, our own interior-point method
    (`dmoc.interior`), which finds the same optima several times faster and hands on to Ipopt what
    does not fit it (RMS torque, conditions on the end, rows with equal bounds) or where it
    gets stuck.
    """

    tolerance: float = 1e-6
    acceptable_tolerance: float = 1e-4
    acceptable_iterations: int = 15
    max_iterations: int = 300
    limit_curve: bool = True
    curve_corrections: int = 5
    solver: str = "ipopt"

    def __post_init__(self) -> None:
        require_solver(self.solver, "params.solver")


Arguments = dict[str, Array]
Minimum = tuple[dict[str, Any], dict[str, Any]]
Minimiser = Callable[[MotionProgramme, Arguments, SolveParams, bool], Minimum]


def minimum(
    motion: MotionProgramme, arguments: Arguments, params: SolveParams, warm: bool
) -> Minimum:
    """What `nlpsol` returns, and its statistics, with the `solver` that found it."""
    return SOLVERS[params.solver](motion, arguments, params, warm)


def require_solver(name: str, field: str) -> str:
    """`name`, if it is a solver's; else `ProblemError` naming those there are."""
    if name in SOLVERS:
        return name
    raise ProblemError.of(
        "solver", field=field, value=name, legal=", ".join(SOLVERS), fix="leave it out"
    )


_IPOPT = {
    "print_level": 0,
    "sb": "yes",
    "nlp_scaling_method": "none",
    "mu_strategy": "adaptive",
    "mu_oracle": "probing",
    "constr_viol_tol": 1e-8,
    # The rows are scaled already; AMF ordering suits the band. Measured: a quarter off.
    # The automatic ordering would also make the last digits depend on earlier solves.
    "mumps_pivot_order": 2,
    "mumps_permuting_scaling": 0,
    "mumps_scaling": 0,
    "min_refinement_steps": 0,
}
_WARM = {
    "warm_start_init_point": "yes",
    "warm_start_bound_push": 1e-4,
    "warm_start_mult_bound_push": 1e-4,
}
_COMPILED: dict[tuple[Any, ...], ca.Function] = {}


def _by_ipopt(
    motion: MotionProgramme, arguments: Arguments, params: SolveParams, warm: bool
) -> Minimum:
    """Ipopt (Wächter and Biegler 2006) with MUMPS; one object per programme and options."""
    key = (motion.key, params, warm)
    if key not in _COMPILED:
        programme = motion.programme
        settings: dict[str, Any] = dict(_IPOPT) | {
            "tol": params.tolerance,
            "acceptable_tol": params.acceptable_tolerance,
            "acceptable_iter": params.acceptable_iterations,
            "max_iter": params.max_iterations,
        }
        settings |= _WARM if warm else {}
        options: dict[str, Any] = {f"ipopt.{name}": value for name, value in settings.items()}
        options |= {
            "print_time": False,
            "no_nlp_grad": True,
            "calc_lam_p": False,
            "grad_f": programme.grad_f,
            "jac_g": programme.jac_g,
            "hess_lag": programme.hess_lag,
        }
        _COMPILED[key] = ca.nlpsol("motion", "ipopt", programme.nlp, options)
    solver = _COMPILED[key]
    return solver(**arguments), solver.stats() | {"solver": "ipopt"}


def _by_structured(
    motion: MotionProgramme, arguments: Arguments, params: SolveParams, warm: bool
) -> Minimum:
    """Our own method; what does not fit it or where it gets stuck goes on to Ipopt.

    From the same start and not from where it stopped: it stops in a corner, where an interior
    method that has a restoration phase would only need it at once.
    """
    from dmoc.interior import solve_structured  # with it numba, which takes a while to load

    own = solve_structured(
        motion,
        arguments,
        params.tolerance,
        params.acceptable_tolerance,
        params.acceptable_iterations,
        params.max_iterations,
    )
    if own is not None and own[1]["return_status"] in STATUS:
        return own
    result, stats = _by_ipopt(motion, arguments, params, warm)
    spent = 0 if own is None else own[1]["iter_count"]
    return result, stats | {"iter_count": stats["iter_count"] + spent}


SOLVERS: dict[str, Minimiser] = {"ipopt": _by_ipopt, "structured": _by_structured}
DEFAULT_PARAMS = SolveParams()
