"""How a motion ended, and what to do about it."""

from __future__ import annotations

from enum import StrEnum


class Status(StrEnum):
    """Expected outcomes of a solve; each has a sentence that says what to do (`advice`)."""

    CONVERGED = "converged"
    ACCEPTABLE = "acceptable"
    COARSE = "coarse"
    INFEASIBLE = "infeasible"
    NO_PATH = "no_path"
    IN_COLLISION = "in_collision"
    UNCERTIFIED = "uncertified"
    ITERATION_LIMIT = "iteration_limit"
    TIME_LIMIT = "time_limit"
    NUMERICAL_FAILURE = "numerical_failure"

    @property
    def ok(self) -> bool:
        """True when the motion may be used."""
        return self in (Status.CONVERGED, Status.ACCEPTABLE, Status.COARSE)

    @property
    def advice(self) -> str:
        """One sentence for the person who asked for the motion."""
        return _ADVICE[self]


_ADVICE: dict[Status, str] = {
    Status.CONVERGED: "The motion is a local optimum within the tolerances; use it.",
    Status.ACCEPTABLE: "The motion meets the looser acceptable tolerances; tighten them or add "
    "iterations if the last digits matter.",
    Status.COARSE: "An optimum of the discrete problem whose executed curve costs over 1 % more or "
    "less than stated: raise the number of intervals; the limits hold as they are.",
    Status.INFEASIBLE: "No motion satisfies all limits: check that torque limits hold the arm at "
    "both ends, that the ends lie within the joint limits, and that a fixed duration is not too "
    "short.",
    Status.NO_PATH: "The planner found no collision-free path within its budget: raise the budget "
    "or the number of seeds, lower the clearance, or give the stud another departure line.",
    Status.IN_COLLISION: "Start or goal touches something: see the named pair; move the stud, "
    "choose another alternative, or declare the contact as allowed.",
    Status.UNCERTIFIED: "A motion exists but is not proven free between its knots: raise the "
    "number of intervals or the repair rounds, or lower the tracking error.",
    Status.ITERATION_LIMIT: "The solver used all its iterations: raise max_iterations or give a "
    "better guess.",
    Status.TIME_LIMIT: "Interrupted by a time limit, so the result depends on the machine: raise "
    "the limit or stop by iterations.",
    Status.NUMERICAL_FAILURE: "The solver met invalid numbers: check inertias and limits of the "
    "robot with `dmoc doctor`, or try another guess.",
}
