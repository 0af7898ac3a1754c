"""The `dmoc` command: parses arguments, runs one command, and turns faults into exit codes.

Exit 0 done, 1 compared runs differ, 2 bad input (coded errors, no traceback), 3 no solution (with
reasons), 130 interrupted (finished work is kept). Every command takes --seed, --out and --json: one
that has no use for a seed accepts it all the same.
"""

from __future__ import annotations

import inspect
import os
import signal
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Annotated, Any

import typer

from dmoc.errors import DmocError, Fault
from sequencing.commands.console import CommandResult, Console

# The base of all usage errors: typer carries its own copy of click and exports only subclasses.
USAGE_ERROR: Any = next(c for c in typer.BadParameter.__mro__ if c.__name__ == "ClickException")

app = typer.Typer(
    name="dmoc",
    no_args_is_help=True,
    add_completion=False,
    pretty_exceptions_enable=False,
    # Rich's own markup takes a unit in square brackets for a style and drops it.
    rich_markup_mode="markdown",
    help="Order, configurations and energy-efficient collision-free motions of robot stations.",
)

SeedOption = Annotated[int, typer.Option(help="Seed of every random choice.")]
OutOption = Annotated[Path | None, typer.Option(help="Folder of the results.")]
JsonOption = Annotated[
    bool, typer.Option("--json", help="One JSON object on stdout, the rest on stderr.")
]
WorkersOption = Annotated[int, typer.Option(help="Processes; 0 takes the number of cores.", min=0)]
ExecutorOption = Annotated[
    str, typer.Option(help="processes, threads, serial, dask or dask://HOST:PORT.")
]
MethodOption = Annotated[str, typer.Option(help="Collision avoidance: half-spaces or boxes.")]
SolverOption = Annotated[str, typer.Option(help="Solver of the motions: structured or ipopt.")]
PolishOption = Annotated[
    bool, typer.Option("--polish", help="Turn the tools continuously once the order is found.")
]
StationArgument = Annotated[
    str, typer.Argument(help="station.yaml, its folder, or the name of an embedded one.")
]
RunArgument = Annotated[Path, typer.Argument(help="Folder of a finished run.")]
COMMON = {"seed": (SeedOption, 0), "out": (OutOption, None), "json": (JsonOption, False)}


def command(function: Callable[..., CommandResult]) -> Callable[..., CommandResult]:
    """Register `function(console, …)` under its name, with the options that all commands have."""
    signature = inspect.signature(function, eval_str=True)
    own = [p for name, p in signature.parameters.items() if name not in ("console", *COMMON)]
    common = [
        inspect.Parameter(name, inspect.Parameter.KEYWORD_ONLY, default=default, annotation=kind)
        for name, (kind, default) in COMMON.items()
    ]

    def run(json: bool, **given: Any) -> None:
        wanted = {name: value for name, value in given.items() if name in signature.parameters}
        _finish(Console(json=json), function, wanted)

    run.__name__, run.__doc__ = function.__name__, function.__doc__
    parameters = [p.replace(kind=inspect.Parameter.KEYWORD_ONLY) for p in own] + common
    run.__signature__ = inspect.Signature(parameters)  # type: ignore[attr-defined]
    run.__annotations__ = {p.name: p.annotation for p in parameters}
    app.command()(run)
    return function


@command
def demo(
    console: Console,
    seed: int,
    out: Path | None,
    workers: WorkersOption = 0,
    method: MethodOption = "half-spaces",
    solver: SolverOption = "structured",
    polish: PolishOption = False,
) -> CommandResult:
    """Plan the embedded eight-stud station, from station.yaml to scene.html."""
    from sequencing.commands.plan import run_demo

    return run_demo(console, seed, out, workers, method, solver, polish)


@command
def plan(
    console: Console,
    station: StationArgument,
    seed: int,
    out: Path | None,
    workers: WorkersOption = 0,
    method: MethodOption = "half-spaces",
    solver: SolverOption = "structured",
    max_evaluations: Annotated[
        int | None, typer.Option(help="Stop after this many solved edges.", min=1)
    ] = None,
    target_gap: Annotated[
        float, typer.Option(help="Stop at this conditional gap in percent.", min=0.0)
    ] = 1.0,
    coverage: Annotated[
        int | None,
        typer.Option(
            help="Random edges held out to judge the estimate: 200, or 99 below 10 studs.", min=1
        ),
    ] = None,
    polish: PolishOption = False,
    executor: ExecutorOption = "processes",
) -> CommandResult:
    """Plan a station: order, configurations, certified motions, tables and scene."""
    from sequencing.commands.plan import run_plan

    return run_plan(
        console,
        station,
        seed=seed,
        out=out,
        workers=workers,
        method=method,
        solver=solver,
        max_evaluations=max_evaluations,
        conditional_gap=target_gap / 100.0,
        polish=polish,
        coverage=coverage,
        executor=executor,
    )


@command
def check(
    console: Console,
    station: StationArgument,
    out: Path | None,
    engines: Annotated[
        bool, typer.Option("--engines", help="Compare the collision engines; > 1 mm is a warning.")
    ] = False,
) -> CommandResult:
    """Read a station and count the alternatives of every stud, or say why there are none."""
    from sequencing.commands.check import run_check

    return run_check(console, station, out, engines)


@command
def init(
    console: Console,
    urdf: Annotated[Path, typer.Argument(help="Robot (URDF or xacro).")],
    part: Annotated[Path, typer.Argument(help="Part mesh (STL, OBJ, GLB, PLY or DAE).")],
    studs: Annotated[Path, typer.Argument(help="Studs (CSV).")],
    out: Path | None,
    unit: Annotated[str, typer.Option(help="Unit of the mesh: m or mm.")] = "m",
    package_path: Annotated[
        list[Path] | None, typer.Option(help="Folder with the robot's ROS packages (repeatable).")
    ] = None,
    xacro_arg: Annotated[
        list[str] | None, typer.Option(help="NAME:=VALUE of a xacro file (repeatable).")
    ] = None,
    total_mass: Annotated[
        float | None, typer.Option(help="Arm's mass in kg: estimate masses, torques, rotors.")
    ] = None,
) -> CommandResult:
    """Write a commented station.yaml from a robot, a part and studs."""
    from sequencing.commands.check import run_init

    return run_init(
        console, urdf, part, studs, out, unit, package_path or [], total_mass, xacro_arg or []
    )


@command
def place(
    console: Console,
    station: StationArgument,
    seed: int,
    out: Path | None,
    span: Annotated[float, typer.Option(help="How far the base may be shifted [m].")] = 0.4,
    step: Annotated[float, typer.Option(help="Step of the grid [m].")] = 0.2,
    yaw: Annotated[float, typer.Option(help="How far the base may be turned [°].")] = 0.0,
    yaw_step: Annotated[float, typer.Option(help="Step of the turns [°].")] = 15.0,
    workers: WorkersOption = 0,
) -> CommandResult:
    """Where the robot would stand better: reach and estimated cost on a grid of places."""
    from sequencing.commands.place import run_place

    return run_place(
        console,
        station,
        span_m=span,
        step_m=step,
        yaw_deg=yaw,
        yaw_step_deg=yaw_step,
        seed=seed,
        out=out,
        workers=workers,
    )


@command
def solve(
    console: Console,
    start: Annotated[str, typer.Option(help="Joint vector a,b,… [rad].")],
    goal: Annotated[str, typer.Option(help="Joint vector a,b,… [rad].")],
    seed: int,
    out: Path | None,
    robot: Annotated[str, typer.Option(help="Name of a robot, or a URDF.")] = "ur10e_class",
    intervals: Annotated[int, typer.Option(help="N, number of intervals.", min=2)] = 40,
    duration: Annotated[float | None, typer.Option(help="Fixed duration [s].")] = None,
    time_weight: Annotated[float, typer.Option(help="c_t.", min=0.0)] = 1.0,
    effort_weight: Annotated[float, typer.Option(help="c_e.", min=0.0)] = 1e-6,
    velocity_weight: Annotated[float, typer.Option(help="c_v.", min=0.0)] = 1.0,
    smoothing: Annotated[float, typer.Option(help="Torque smoothing.", min=0.0)] = 1e-2,
    payload: Annotated[float, typer.Option(help="Payload at the flange [kg].", min=0.0)] = 0.0,
) -> CommandResult:
    """One optimal motion between two joint vectors, without obstacles."""
    from sequencing.commands.solve import run_solve

    return run_solve(
        console,
        robot,
        start,
        goal,
        intervals=intervals,
        duration=duration,
        weights=(time_weight, effort_weight, velocity_weight, smoothing),
        payload=payload,
        seed=seed,
        out=out,
    )


@command
def gtsp(
    console: Console,
    file: Annotated[Path, typer.Argument(help="Instance in the .gtsp format.")],
    seed: int,
    out: Path | None,
    exact: Annotated[bool, typer.Option("--exact", help="Prove the optimum.")] = False,
    effort: Annotated[str, typer.Option(help="quick, normal or thorough.")] = "normal",
) -> CommandResult:
    """Solve a generalised travelling salesman instance."""
    from sequencing.commands.gtsp import run_gtsp

    return run_gtsp(console, file, seed, exact, effort, out)


@command
def schedule(
    console: Console,
    cell: Annotated[str, typer.Argument(help="cell.yaml, or the name of an embedded cell.")],
    seed: int,
    out: Path | None,
) -> CommandResult:
    """Time several robots on their DC links, without collisions."""
    from sequencing.commands.schedule import run_schedule_command

    return run_schedule_command(console, cell, seed, out)


@command
def study(
    console: Console,
    name: Annotated[str, typer.Argument(help="stud-welding, pallet-cell or ur3.")],
    seed: int,
    out: Path | None,
    station: Annotated[str, typer.Option(help="Station of stud-welding: A, B or C.")] = "A",
    reduced: Annotated[
        bool, typer.Option("--reduced", help="Few cases, in about a minute (stud-welding, ur3).")
    ] = False,
    workers: WorkersOption = 0,
    solver: Annotated[str | None, typer.Option(help="Solver, instead of the study's own.")] = None,
    method: Annotated[str | None, typer.Option(help="Method, instead of the study's own.")] = None,
) -> CommandResult:
    """Run a published study and print its figures beside the paper's."""
    from sequencing.commands.study import StudyOptions, run_study

    options = StudyOptions(station, seed, out, workers, reduced, solver, method)
    return run_study(console, name, options)


@command
def export(
    console: Console,
    run: RunArgument,
    out: Path | None,
    format: Annotated[str, typer.Option(help="csv, ros, rtde, urscript, rapid or krl.")] = "csv",
    step: Annotated[float | None, typer.Option(help="Sampling of streamed formats [s].")] = None,
) -> CommandResult:
    """Write the motions of a run for a controller."""
    from sequencing.commands.runs import run_export

    return run_export(console, run, format, step, out)


@command
def view(console: Console, run: RunArgument, out: Path | None) -> CommandResult:
    """Write pictures, report and scene of a run again and say where they are."""
    from sequencing.commands.runs import run_view

    return run_view(console, run, out)


@command
def compare(
    console: Console,
    first: RunArgument,
    second: Annotated[Path, typer.Argument(help="Folder of another finished run.")],
    out: Path | None,
    tolerance: Annotated[
        float | None,
        typer.Option(help="Exit 1 where anything differs by more, relative above 1.", min=0.0),
    ] = None,
) -> CommandResult:
    """Compare two runs; with --tolerance, say what differs and exit 1."""
    from sequencing.commands.runs import run_compare

    return run_compare(console, first, second, out, tolerance)


@command
def measured(
    console: Console,
    log: Annotated[Path, typer.Argument(help="Log of a controller (CSV).")],
    run: Annotated[Path, typer.Argument(help="Folder of the run that was driven.")],
    out: Path | None,
) -> CommandResult:
    """Compare a controller's log with the plan: time, position, current, energy."""
    from sequencing.commands.runs import run_measured

    return run_measured(console, log, run, out)


@command
def identify(
    console: Console,
    logs: Annotated[list[Path], typer.Argument(help="Logs to fit (CSV), 20 s of rich motion.")],
    robot: Annotated[Path, typer.Option(help="robot.yaml or URDF of the robot.")],
    out: Path | None,
    hold: Annotated[
        list[Path] | None, typer.Option(help="Log to judge by, not fitted (repeatable).")
    ] = None,
    payload: Annotated[
        str | None, typer.Option(help="Known payload KG,x,y,z in the flange frame [kg, m].")
    ] = None,
    torque_source: Annotated[
        str | None, typer.Option(help="motor_torque, actual_torque or actual_current.")
    ] = None,
    cutoff: Annotated[
        float, typer.Option(help="Cut-off of the filter [Hz]; 20 for fast small arms.", min=0.5)
    ] = 10.0,
) -> CommandResult:
    """Fit a robot's dynamics and friction to its logs, and write robot.urdf and robot.yaml."""
    from sequencing.commands.identify import run_identify

    return run_identify(console, logs, robot, hold or [], payload, torque_source, cutoff, out)


@command
def doctor(console: Console, out: Path | None) -> CommandResult:
    """Say what is installed, which backends run, and whether a solve works."""
    from sequencing.commands.doctor import run_doctor

    return run_doctor(console, out)


def _finish(
    console: Console, function: Callable[..., CommandResult], given: dict[str, Any]
) -> None:
    """Run a command and leave with its exit code; bad input becomes coded errors and exit 2."""
    try:
        outcome = function(console, **given)
    except DmocError as error:
        console.errors(error.faults)
        raise SystemExit(2) from None
    except KeyboardInterrupt:
        console.say("interrupted; finished edges are kept and the next run goes on from them")
        console.result({"status": "interrupted"})
        raise SystemExit(130) from None
    except OSError as error:
        fault = Fault(
            "file-access",
            file=str(error.filename or ""),
            value=error.strerror or str(error),
            legal="files that can be read and folders that can be written",
            fix="check --out and the paths, their permissions and the free space",
        )
        console.errors((fault,))
        raise SystemExit(2) from None
    console.result(outcome.data)
    raise SystemExit(outcome.exit_code)


def main() -> None:
    """Entry point of the `dmoc` script."""
    # One thread a process: edges run side by side in processes, and BLAS threads only fight them.
    # numpy is imported by the commands, later than this.
    for variable in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"):
        os.environ.setdefault(variable, "1")
    # A terminated run stops like an interrupted one, so that workers end and the store is closed.
    signal.signal(signal.SIGTERM, signal.default_int_handler)
    try:
        code = app(standalone_mode=False)
    except USAGE_ERROR as error:
        if type(error).__name__ == "NoArgsIsHelpError":
            sys.stderr.write(error.format_message() + "\n")
            raise SystemExit(2) from None
        fault = Fault(
            "command-line",
            field=" ".join(sys.argv[1:2]),
            value=error.format_message(),
            fix="see `dmoc --help` and `dmoc COMMAND --help`",
        )
        Console(json="--json" in sys.argv).errors((fault,))
        raise SystemExit(2) from None
    except (typer.Abort, KeyboardInterrupt):
        raise SystemExit(130) from None
    raise SystemExit(code if isinstance(code, int) else 0)
