"""The `dmoc` command: parses arguments, runs one command, and turns faults into exit codes.

Exit 0 done, 1 compared runs differ, 2 bad input (coded errors, no traceback), 3 no solution (with
reasons), 130 interrupted (finished work is kept).
"""

from __future__ import annotations

import os
import signal
import sys
from pathlib import Path
from typing import Annotated, Any

import typer

from dmoc.errors import DmocError, Fault
from sequencing.commands.console import Console, Outcome

# The base of all usage errors: typer carries its own copy of click and exports only subclasses.
USAGE_ERROR: Any = next(c for c in typer.BadParameter.__mro__ if c.__name__ == "ClickException")

app = typer.Typer(
    name="dmoc", no_args_is_help=True, add_completion=False, pretty_exceptions_enable=False,
    help="Order, configurations and energy-efficient collision-free motions of robot stations.",
)  # fmt: skip

Seed = Annotated[int, typer.Option(help="Seed of every random choice.")]
Json = Annotated[
    bool, typer.Option("--json", help="One JSON object on stdout, the rest on stderr.")
]
Out = Annotated[Path | None, typer.Option(help="Folder of the results.")]
Workers = Annotated[int, typer.Option(help="Processes; 0 takes the number of cores.", min=0)]
Method = Annotated[str, typer.Option(help="Collision avoidance: halfspaces or boxes.")]
Polish = Annotated[
    bool, typer.Option("--polish", help="Turn the tools continuously once the order is found.")
]


@app.command()
def demo(
    seed: Seed = 0,
    out: Out = None,
    json: Json = False,
    workers: Workers = 0,
    method: Method = "halfspaces",
    polish: Polish = False,
) -> None:
    """Plan the embedded eight-stud station, from station.yaml to scene.html."""
    from sequencing.commands.plan import run_demo

    _finish(json, lambda console: run_demo(console, seed, out, workers, method, polish))


@app.command()
def plan(
    station: Annotated[str, typer.Argument(help="station.yaml, or the name of an embedded one.")],
    seed: Seed = 0,
    out: Out = None,
    json: Json = False,
    workers: Workers = 0,
    method: Method = "halfspaces",
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
    polish: Polish = False,
) -> None:
    """Plan a station: order, configurations, certified motions, tables and scene."""
    from sequencing.commands.plan import run_plan

    _finish(
        json,
        lambda console: run_plan(
            console,
            station,
            seed,
            out,
            workers,
            method,
            max_evaluations,
            target_gap / 100.0,
            polish,
            coverage,
        ),
    )


@app.command()
def check(
    station: Annotated[str, typer.Argument(help="station.yaml, or the name of an embedded one.")],
    json: Json = False,
    seed: Seed = 0,
    out: Out = None,
    engines: Annotated[
        bool, typer.Option("--engines", help="Compare the collision engines; > 1 mm is a warning.")
    ] = False,
) -> None:
    """Read a station and count the alternatives of every stud, or say why there are none."""
    from sequencing.commands.check import run_check

    del seed  # nothing in a check is random; the option exists because every command takes it
    _finish(json, lambda console: run_check(console, station, out, engines))


@app.command()
def init(
    urdf: Annotated[Path, typer.Argument(help="Robot (URDF).")],
    part: Annotated[Path, typer.Argument(help="Part mesh (STL, OBJ or GLB).")],
    studs: Annotated[Path, typer.Argument(help="Studs (CSV).")],
    out: Out = None,
    unit: Annotated[str, typer.Option(help="Unit of the mesh: m or mm.")] = "m",
    json: Json = False,
    seed: Seed = 0,
) -> None:
    """Write a commented station.yaml from a robot, a part and studs."""
    from sequencing.commands.check import run_init

    del seed
    _finish(json, lambda console: run_init(console, urdf, part, studs, out, unit))


@app.command()
def place(
    station: Annotated[str, typer.Argument(help="station.yaml, its folder, or an embedded name.")],
    span: Annotated[float, typer.Option(help="How far the base may be shifted [m].")] = 0.4,
    step: Annotated[float, typer.Option(help="Step of the grid [m].")] = 0.2,
    yaw: Annotated[float, typer.Option(help="How far the base may be turned [°].")] = 0.0,
    yaw_step: Annotated[float, typer.Option(help="Step of the turns [°].")] = 15.0,
    seed: Seed = 0,
    out: Out = None,
    workers: Workers = 0,
    json: Json = False,
) -> None:
    """Where the robot would stand better: reach and estimated cost on a grid of places."""
    from sequencing.commands.place import run_place

    _finish(
        json,
        lambda console: run_place(console, station, span, step, yaw, yaw_step, seed, out, workers),
    )


@app.command()
def solve(
    start: Annotated[str, typer.Option(help="Joint vector a,b,… [rad].")],
    goal: Annotated[str, typer.Option(help="Joint vector a,b,… [rad].")],
    robot: Annotated[str, typer.Option(help="Name of a robot, or a URDF.")] = "ur10e_class",
    intervals: Annotated[int, typer.Option(help="N, number of intervals.", min=2)] = 40,
    duration: Annotated[float | None, typer.Option(help="Fixed duration [s].")] = None,
    time_weight: Annotated[float, typer.Option(help="c_t.", min=0.0)] = 1.0,
    effort_weight: Annotated[float, typer.Option(help="c_e.", min=0.0)] = 1e-6,
    velocity_weight: Annotated[float, typer.Option(help="c_v.", min=0.0)] = 1.0,
    smoothing: Annotated[float, typer.Option(help="Torque smoothing.", min=0.0)] = 1e-2,
    payload: Annotated[float, typer.Option(help="Payload at the flange [kg].", min=0.0)] = 0.0,
    seed: Seed = 0,
    out: Out = None,
    json: Json = False,
) -> None:
    """One optimal motion between two joint vectors, without obstacles."""
    from sequencing.commands.solve import run_solve

    weights = (time_weight, effort_weight, velocity_weight, smoothing)
    _finish(
        json,
        lambda console: run_solve(
            console, robot, start, goal, intervals, duration, weights, payload, seed, out
        ),
    )


@app.command()
def gtsp(
    file: Annotated[Path, typer.Argument(help="Instance in the .gtsp format.")],
    seed: Seed = 0,
    exact: Annotated[bool, typer.Option("--exact", help="Prove the optimum.")] = False,
    effort: Annotated[str, typer.Option(help="quick, normal or thorough.")] = "normal",
    out: Out = None,
    json: Json = False,
) -> None:
    """Solve a generalised travelling salesman instance."""
    from sequencing.commands.gtsp import run_gtsp

    _finish(json, lambda console: run_gtsp(console, file, seed, exact, effort, out))


@app.command()
def schedule(
    cell: Annotated[str, typer.Argument(help="cell.yaml, or the name of an embedded cell.")],
    seed: Seed = 0,
    out: Out = None,
    json: Json = False,
) -> None:
    """Time several robots on their DC links, without collisions."""
    from sequencing.commands.schedule import run_schedule_command

    _finish(json, lambda console: run_schedule_command(console, cell, seed, out))


@app.command()
def study(
    name: Annotated[str, typer.Argument(help="stud-welding, pallet-cell or ur3.")],
    station: Annotated[str, typer.Option(help="Station of stud-welding: A, B or C.")] = "A",
    reduced: Annotated[
        bool, typer.Option("--reduced", help="Few cases, in about a minute (stud-welding, ur3).")
    ] = False,
    seed: Seed = 0,
    out: Out = None,
    workers: Workers = 0,
    json: Json = False,
) -> None:
    """Run a published study and print its figures beside the paper's."""
    from sequencing.commands.study import run_study

    _finish(json, lambda console: run_study(console, name, station, seed, out, workers, reduced))


@app.command()
def export(
    run: Annotated[Path, typer.Argument(help="Folder of a finished run.")],
    format: Annotated[str, typer.Option(help="csv, ros, rtde, urscript, rapid or krl.")] = "csv",
    step: Annotated[float | None, typer.Option(help="Sampling of streamed formats [s].")] = None,
    out: Out = None,
    json: Json = False,
    seed: Seed = 0,
) -> None:
    """Write the motions of a run for a controller."""
    from sequencing.commands.runs import run_export

    del seed
    _finish(json, lambda console: run_export(console, run, format, step, out))


@app.command()
def view(
    run: Annotated[Path, typer.Argument(help="Folder of a finished run.")],
    out: Out = None,
    json: Json = False,
    seed: Seed = 0,
) -> None:
    """Write pictures, report and scene of a run again and say where they are."""
    from sequencing.commands.runs import run_view

    del seed
    _finish(json, lambda console: run_view(console, run, out))


@app.command()
def compare(
    first: Annotated[Path, typer.Argument(help="Folder of a finished run.")],
    second: Annotated[Path, typer.Argument(help="Folder of another finished run.")],
    tolerance: Annotated[
        float | None,
        typer.Option(help="Exit 1 where anything differs by more, relative above 1.", min=0.0),
    ] = None,
    out: Out = None,
    json: Json = False,
    seed: Seed = 0,
) -> None:
    """Compare two runs; with --tolerance, say what differs and exit 1."""
    from sequencing.commands.runs import run_compare

    del seed
    _finish(json, lambda console: run_compare(console, first, second, out, tolerance))


@app.command()
def measured(
    log: Annotated[Path, typer.Argument(help="Log of a controller (CSV).")],
    run: Annotated[Path, typer.Argument(help="Folder of the run that was driven.")],
    out: Out = None,
    json: Json = False,
    seed: Seed = 0,
) -> None:
    """Compare a controller's log with the plan: time, position, current, energy."""
    from sequencing.commands.measured import run_measured

    del seed
    _finish(json, lambda console: run_measured(console, log, run, out))


@app.command()
def doctor(json: Json = False, seed: Seed = 0, out: Out = None) -> None:
    """Say what is installed, which backends run, and whether a solve works."""
    from sequencing.commands.doctor import run_doctor

    del seed
    _finish(json, lambda console: run_doctor(console, out))


def _finish(json: bool, command: object) -> None:
    """Run a command and leave with its exit code; bad input becomes coded errors and exit 2."""
    console = Console(json=json)
    assert callable(command)
    try:
        outcome: Outcome = command(console)
    except DmocError as error:
        console.errors(error.faults)
        raise SystemExit(2) from None
    except KeyboardInterrupt:
        console.say("interrupted; finished edges are kept and the next run goes on from them")
        console.result({"status": "interrupted"})
        raise SystemExit(130) from None
    except OSError as error:
        fault = Fault(
            "file-access", file=str(error.filename or ""), value=error.strerror or str(error),
            legal="files that can be read and folders that can be written",
            fix="check --out and the paths, their permissions and the free space",
        )  # fmt: skip
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
            "command-line", field=" ".join(sys.argv[1:2]), value=error.format_message(),
            fix="see `dmoc --help` and `dmoc COMMAND --help`",
        )  # fmt: skip
        Console(json="--json" in sys.argv).errors((fault,))
        raise SystemExit(2) from None
    except (typer.Abort, KeyboardInterrupt):
        raise SystemExit(130) from None
    raise SystemExit(code if isinstance(code, int) else 0)
