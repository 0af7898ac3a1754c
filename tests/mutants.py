"""Mutants of what carries a promise: each slip below must make its test fail.

`make mutants` puts them one by one into a copy of the sources and runs the test named beside
them; `python -m tests.mutants WORD …` only those whose file or test has the word in it.
"""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
import tempfile
from dataclasses import dataclass
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent
COPIED = ("dmoc", "planning", "sequencing", "studies", "authoring", "examples", "tests")
PROOF, CERTIFICATE = "planning/collision/kernels/proof.py", "planning/collision/certificate.py"
TRAVEL, CURVES = "sequencing/bounds/travel.py", "sequencing/bounds/curves.py"
SERIES, BOXES = "sequencing/bounds/series.py", "dmoc/refinement/boxes.py"
BASELINE, WORKER = "sequencing/cycle/baseline.py", "sequencing/edges/worker.py"
JOBS, STORE = "sequencing/edges/jobs.py", "sequencing/edges/store.py"
PROVEN, BOUND = "tests/planning/test_certificate.py", "tests/sequencing/test_bounds.py"
RULES, KEYS = "tests/regression/test_rules.py", "tests/sequencing/test_keys.py"
ENTRIES, CYCLE = "tests/sequencing/test_store.py", "tests/sequencing/test_cycle.py::"
BACKWARDS = CYCLE + "test_a_cycle_driven_backwards_is_no_other_sequence"
MEDIAN = CYCLE + "test_the_old_method_never_looks_worse_than_its_median"


@dataclass(frozen=True)
class Mutant:
    """`text` stands once in `file`; with `slip` in its place `test` must fail."""

    file: str
    text: str
    slip: str
    test: str


MUTANTS = (
    Mutant(CERTIFICATE, "q[:-1] + h * v[:-1] / 3, q[1:]", "q[:-1] + h * v[:-1] / 2, q[1:]", PROVEN),
    Mutant(CERTIFICATE, "q[1:] - h * v[1:] / 3", "q[1:] + h * v[1:] / 3", PROVEN),
    Mutant(CERTIFICATE, "3 * r * r * s * b1 +", "3 * r * s * s * b1 +", PROVEN),
    Mutant(CERTIFICATE, "        clearance.tracking_error_m,\n", "        0.0,\n", PROVEN),
    Mutant(CERTIFICATE, "        not failures,\n", "        True,\n", PROVEN),
    Mutant(CERTIFICATE, "0.0, 0.0)[0] == 0", "0.0, 0.0)[0] >= 0", PROVEN),
    Mutant(PROOF, "for k in range(3):", "for k in range(0):", PROVEN),
    Mutant(PROOF, "        delta[j] = spread", "        delta[j] = 0.1 * spread", PROVEN),
    Mutant(PROOF, "touching or depth == max_depth", "touching", PROVEN),
    Mutant(PROOF, "for i in range(num_intervals):", "for i in range(num_intervals - 1):", PROVEN),
    Mutant(PROOF, "lo + half, half, depth + 1", "lo, half, depth + 1", PROVEN),
    Mutant(PROOF, "surplus[m] - tolerance < level", "surplus[m] + 1.0 < level", PROVEN),
    Mutant(TRAVEL, "other) * square[row, m]", "other) * 4.0 * square[row, m]", BOUND),
    Mutant(TRAVEL, "before = spent[i, k - 1, c] + ", "before = spent[i, k, c] + ", BOUND),
    Mutant(TRAVEL, "    if best >= least:", "    if best >= 0.0:", BOUND),
    Mutant(CURVES, "t <= v / a, 0.5 * a * t * t", "t <= v / a, 0.2 * a * t * t", BOUND),
    Mutant(CURVES, "s * (2.0 - s) * square", "s * (2.0 + s) * square", BOUND),
    Mutant(CURVES, "            rate[v, k] = worst", "            rate[v, k] = here", BOUND),
    Mutant(CURVES, "worst = min(worst, here)", "worst = max(-worst, here)", BOUND),
    Mutant(CURVES, "best = min(0.0, a * u * u -", "best = min(1.0, a * u * u -", BOUND),
    Mutant(CURVES, "min(w, b * u / c)", "w", BOUND),
    Mutant(CURVES, "min(u, b * w / a)", "u", BOUND),
    Mutant(SERIES, "table[1:] *= 2.0", "table[1:] *= 1.0", BOUND),
    Mutant(SERIES, "spread=rest.sum(axis=0)", "spread=rest.max(axis=0)", BOUND),
    Mutant(BOXES, "(weights.shape[1] * weights)", "weights", RULES),
    Mutant(BOXES, "above = view.phi_m - required", "above = view.phi_m", RULES),
    Mutant(BOXES, "np.minimum.at(half, points.interval, width)", "pass", RULES),
    Mutant(BASELINE, "    return min(there, (", "    return max(there, (", BACKWARDS),
    Mutant(BASELINE, "*reversed(there[1:])", "*there[1:]", BACKWARDS),
    Mutant(BASELINE, "max(0, count - 1) // 2", "count // 2", MEDIAN),
    Mutant(JOBS, "|{kind}|{self.seed}|", "|{self.seed}|", KEYS),
    Mutant(JOBS, "|{kind}|{self.seed}|", "|{kind}|", KEYS),
    Mutant(JOBS, "self.nodes.q_rad[node].tobytes() + ", "", KEYS),
    Mutant(JOBS, " + self.nodes.line_end_rad[node].tobytes()", "", KEYS),
    Mutant(JOBS, "                tuple(stud.normal),\n", "", KEYS),
    Mutant(JOBS, "                stud.depart_m,\n", "", KEYS),
    Mutant(JOBS, "                self.station.stray_m,\n", "", KEYS),
    Mutant(WORKER, "{method}|{station.cost!r}|", "{method}|", KEYS),
    Mutant(WORKER, "|{station.clearance_m!r}", "", KEYS),
    Mutant(WORKER, "{robot.fingerprint}", "", KEYS),
    Mutant(WORKER, "{shape_fingerprint(robot)}", "", KEYS),
    Mutant(WORKER, "(*station.tool_bodies, *station.obstacles)", "station.obstacles", KEYS),
    Mutant(WORKER, "{shape.kind}{shape.size_m!r}", "{shape.kind}", KEYS),
    Mutant(WORKER, "(sorted(station.allowed_collisions), ", "(0, ", KEYS),
    Mutant(WORKER, " + path.read_bytes())", ")", KEYS),
    Mutant(STORE, 'key.encode() + b"|" + payload', 'key.encode() + b"|"', ENTRIES),
    Mutant(STORE, 'key.encode() + b"|" + payload', "payload", ENTRIES),
    Mutant(STORE, "value >= 0.0 and (", "(", ENTRIES),
)


def copied(folder: Path) -> None:
    """The sources in `folder`, with what is compiled of them."""
    for name in COPIED:
        shutil.copytree(ROOT / name, folder / name)
    shutil.copyfile(ROOT / "pyproject.toml", folder / "pyproject.toml")


def killed(mutant: Mutant, folder: Path) -> bool:
    """Whether the test of `mutant` fails with it in the copy in `folder`, which stays as it was."""
    path = folder / mutant.file
    whole, text = path.stat(), path.read_text(encoding="utf-8")
    if text.count(mutant.text) != 1:
        raise ValueError(f"{mutant.file}: not once: {mutant.text!r}")
    path.write_text(text.replace(mutant.text, mutant.slip), encoding="utf-8")
    own = {**os.environ, "PYTHONPATH": str(folder), "PYTHONDONTWRITEBYTECODE": "1"}
    command = [sys.executable, "-m", "pytest", "-q", "-x", "-p", "no:cacheprovider", mutant.test]
    try:
        done = subprocess.run(command, cwd=folder, env=own, capture_output=True, check=False)
    finally:
        path.write_text(text, encoding="utf-8")
        os.utime(path, ns=(whole.st_atime_ns, whole.st_mtime_ns))
    if done.returncode not in (0, 1):
        raise RuntimeError(done.stdout.decode()[-2000:] + done.stderr.decode()[-2000:])
    return done.returncode == 1


def main(words: list[str]) -> int:
    """Print a line a mutant; 1 if one survives."""
    alive = 0
    chosen = [m for m in MUTANTS if not words or any(w in m.file + m.test for w in words)]
    with tempfile.TemporaryDirectory(prefix="mutants-") as name:
        copied(Path(name))
        for mutant in chosen:
            dead = killed(mutant, Path(name))
            alive += not dead
            slip = f"{mutant.text.strip()!r} -> {mutant.slip.strip()!r}"
            print("killed  " if dead else "SURVIVES", mutant.file, slip, flush=True)
    print(f"{len(chosen) - alive} of {len(chosen)} mutants killed")
    return int(alive > 0)


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
