"""`dmoc gtsp`: one generalised travelling salesman instance."""

from __future__ import annotations

from pathlib import Path

from sequencing.commands.console import CommandResult, Console, save_json
from sequencing.gtsp.file_report import run_gtsp_file


def run_gtsp(
    console: Console, file: Path, seed: int, exact: bool, effort: str, out: Path | None
) -> CommandResult:
    """Solve the file; `out`/tour.json holds the same object as `--json`."""
    data = run_gtsp_file(file, seed=seed, exact=exact, effort=effort)
    proof = "proven optimal" if data["proven"] else f"lower bound {data['lower_bound']}"
    console.show(f"cost {data['cost']} ({proof}), {data['method']}, {data['cpu_s']:.2f} s CPU")
    console.show("tour " + " ".join(str(node) for node in data["tour"]))
    save_json(out, "tour.json", data)
    return CommandResult(data, 0 if data["tour"] else 3)
