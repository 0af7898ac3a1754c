"""Write the URDF files of the package: `python -m authoring.robots.generate [FOLDER]`."""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np

from authoring.robots import irb6640, ur3e, ur10e
from authoring.robots.spec import urdf_text

HERE = Path(__file__).resolve().parents[2] / "dmoc" / "robots"


def write_robots(folder: Path) -> tuple[Path, ...]:
    """Write every robot's URDF below `folder`; returns the files. Same bytes on every run."""
    texts = {
        "irb6640_class": urdf_text("irb6640_class", irb6640.LINKS, irb6640.JOINTS),
        # The maker's flange frame: z leaves the flange along joint 6.
        "ur10e_class": urdf_text(
            "ur10e_class", ur10e.LINKS, ur10e.JOINTS, flange_rpy_rad=(np.pi / 2, 0.0, 0.0)
        ),
        "ur3e_class": urdf_text(
            "ur3e_class", ur3e.LINKS, ur3e.JOINTS, flange_rpy_rad=(np.pi / 2, 0.0, 0.0)
        ),
    }
    written = []
    for name, text in texts.items():
        path = folder / name / f"{name}.urdf"
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(text, encoding="utf-8", newline="\n")
        written.append(path)
    return tuple(written)


if __name__ == "__main__":
    write_robots(Path(sys.argv[1]) if len(sys.argv) > 1 else HERE)
