"""Run every benchmark, one process after the other: `python -m benchmarks [NAME …]`.

Each prints its table and saves it to `benchmarks/results/`. Peers that are not installed are
left out and named.
"""

from __future__ import annotations

import subprocess
import sys

NAMES = (
    "ocp",
    "distances",
    "random_pairs",
    "clearance",
    "planning",
    "gtsp",
    "holes",
    "timing",
    "skoda",
    "ur3e_energy",
    "ur3",
)


def main() -> int:
    """Exit code 1 if a benchmark failed."""
    chosen = sys.argv[1:] or list(NAMES)
    failed = []
    for name in chosen:
        if name not in NAMES:
            sys.stderr.write(f"no benchmark {name}; there are {', '.join(NAMES)}\n")
            return 2
        print(f"== {name}", flush=True)
        if subprocess.run([sys.executable, "-m", f"benchmarks.{name}"], check=False).returncode:
            failed.append(name)
    if failed:
        print("failed: " + ", ".join(failed))
    return 1 if failed else 0


if __name__ == "__main__":
    sys.exit(main())
