"""`dmoc doctor`: versions, backends, and one small solve as a sign of life."""

from __future__ import annotations

import os
import platform
import time
from dataclasses import asdict
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path

import numpy as np

from sequencing.commands.console import CommandResult, Console, save_json

PACKAGES = (
    "dmoc",
    "casadi",
    "pin",
    "coal",
    "python-fcl",
    "ompl",
    "numpy",
    "scipy",
    "numba",
    "networkx",
    "toppra",
    "pydantic",
    "viser",
    "mujoco",
)


def run_doctor(console: Console, out: Path | None) -> CommandResult:
    """Print what was found; exit 3 if the solve does not work."""
    from dmoc.motion.motion import MotionProblem
    from dmoc.programme.codegen import backend_report
    from dmoc.robot.robot import available_robots, load_robot
    from dmoc.solving.solver import solve
    from planning.collision.scene import ENGINES

    backend = backend_report()
    versions = {name: _version(name) for name in PACKAGES}
    robot = load_robot("ur10e_class")
    problem = MotionProblem(robot, np.zeros(6), np.full(6, 0.5), num_intervals=20)
    began = time.process_time()
    motion = solve(problem)
    data = {
        "python": platform.python_version(),
        "machine": platform.machine(),
        "cores": os.cpu_count(),
        "packages": versions,
        "backend": {**asdict(backend), "folder": str(backend.folder)},
        "collision": {"default": ENGINES[0], "second_opinions": list(ENGINES[1:])},
        "robots": list(available_robots()),
        "solve": {
            "status": motion.status.value,
            "cost": motion.cost,
            "cpu_s": time.process_time() - began,
        },
    }
    console.show(f"python {data['python']} on {data['machine']}, {data['cores']} cores")
    for name, found in versions.items():
        console.show(f"  {name:<12} {found or 'not installed'}")
    console.show(f"  backend      {backend.mode}; compiler {backend.compiler or 'none'}")
    console.show(
        f"  compiled     {backend.libraries} libraries in {backend.folder}"
        + ("" if backend.writable else " (not ours alone to write: the virtual machine evaluates)")
    )
    console.show(
        f"  collision    {ENGINES[0]} (distances carry their proof, and take a tenth of the time); "
        f"second opinions {', '.join(ENGINES[1:])}: dmoc check --engines"
    )
    console.show(f"  robots       {', '.join(available_robots())}")
    console.show(f"  solve        {motion.status.value}, cost {motion.cost:.6g}")
    save_json(out, "doctor.json", data)
    return CommandResult(data, 0 if motion.status.ok else 3)


def _version(name: str) -> str | None:
    try:
        return version(name)
    except PackageNotFoundError:
        return None
