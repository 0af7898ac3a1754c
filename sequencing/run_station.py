"""The station of a finished run, found again."""

from __future__ import annotations

import json
from pathlib import Path

from dmoc.errors import Fault, InputError
from planning.station import Station, available_stations, demo_station, load_station
from sequencing.run_files import Run


def station_of(run: Run) -> Station:
    """The station that `run` was planned in: embedded, or from the file it was read from.

    Errors: `InputError` run-station when the file is gone or the station has changed since.
    """
    wanted = run.result["inputs"]["station_fingerprint"]
    value = "no station file"
    for candidate in _candidates(run):
        station = (
            load_station(candidate) if isinstance(candidate, Path) else demo_station(candidate)
        )
        if station.fingerprint == wanted:
            return station
        value = "the station has changed since the run"
    raise InputError(
        Fault("run-station", file=str(run.folder), field="inputs.station_fingerprint", value=value,
              legal=f"a station with fingerprint {wanted[:12]}…", fix="plan the station again")
    )  # fmt: skip


def _candidates(run: Run) -> list[str | Path]:
    found: list[str | Path] = []
    timing = run.folder / "timing.json"
    if timing.is_file():
        try:
            source = json.loads(timing.read_text(encoding="utf-8")).get("station_source", "")
        except (ValueError, AttributeError):
            source = ""
        if source and Path(source).is_file():
            found.append(Path(source))
    return found + [name for name in available_stations() if run.name in name or name in run.name]
