"""The schema of cell.yaml: several robots, their trajectories, hand-overs and DC links."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import BaseModel, ConfigDict, Field

from planning.station.schema import ObstacleEntry, PoseEntry, ToolEntry

Volts = Annotated[float, Field(allow_inf_nan=False, ge=10, le=5000)]
NotNegative = Annotated[float, Field(allow_inf_nan=False, ge=0)]
Name = Annotated[str, Field(min_length=1, max_length=80, pattern=r"^[A-Za-z0-9_.-]+$")]


class _Entry(BaseModel):
    model_config = ConfigDict(extra="forbid", strict=True, frozen=True)


Push = Annotated[float, Field(allow_inf_nan=False, ge=-1e5, le=1e5)]
Triple = Annotated[list[Push], Field(min_length=3, max_length=3)]


class LoadEntry(_Entry):
    """What the robot carries or pushes against on some of its trajectories, counted from 0.

    `payload_kg` at the tool tip; `force_n` and `torque_nm` act on the flange, in world axes. A
    later entry overrides an earlier one.
    """

    trajectories: Annotated[
        list[Annotated[int, Field(ge=0, le=100_000)]], Field(min_length=1, max_length=100_000)
    ]
    payload_kg: Annotated[float, Field(allow_inf_nan=False, ge=0, le=5000)] | None = None
    force_n: Triple | None = None
    torque_nm: Triple | None = None


class CellRobotEntry(_Entry):
    """One robot. Its motions: `trajectories` (a folder with motions.npz or waypoints.csv) or `run`.

    `run` is the folder of a finished `dmoc plan`; robot, tool inertia, limits and weld times come
    from it, `base` moves it into the cell and `tool` may add the tool's shapes. `order: free`
    allows its jobs (runs of trajectories from one joint vector back to it) to be exchanged.
    """

    name: Name
    model: str | None = None
    urdf: str | None = None
    base: PoseEntry = PoseEntry()
    trajectories: str | None = None
    run: str | None = None
    payload_kg: Annotated[float, Field(allow_inf_nan=False, ge=0, le=5000)] = 0.0
    tool: ToolEntry | None = None
    loads: Annotated[list[LoadEntry], Field(max_length=10_000)] = []
    order: Literal["given", "free"] = "given"


class HandoverEntry(_Entry):
    """`to` may start only when `from` has ended; both are ROBOT/NUMBER, counted from 0."""

    model_config = ConfigDict(extra="forbid", strict=True, frozen=True, populate_by_name=True)
    from_: str = Field(alias="from")
    to: str


class LinkEntry(_Entry):
    """DC link: one for all (`shared: true`), one each (false), or groups of robots' names.

    The capacitance is that of one link.
    """

    capacitance_f: Annotated[float, Field(allow_inf_nan=False, ge=1e-6, le=1e3)]
    voltage_v: Volts
    chopper_v: Volts
    chopper_off_v: Volts | None = None
    chopper_ohm: Annotated[float, Field(allow_inf_nan=False, ge=0.01, le=1e4)] | None = None
    rectifier_drop_v: NotNegative = 1.0
    shared: bool | list[list[str]] = True


class CellFile(_Entry):
    """cell.yaml, schema version 1. Paths are relative to the file."""

    schema_version: Literal[1]
    name: Name
    robots: Annotated[list[CellRobotEntry], Field(min_length=1, max_length=20)]
    link: LinkEntry
    obstacles: list[ObstacleEntry] = []
    handovers: list[HandoverEntry] = []
    base_load_w: NotNegative = 0.0
    clearance_m: Annotated[float, Field(allow_inf_nan=False, ge=0, le=0.5)] = 0.02
