"""The schema of station.yaml: pydantic models, and their faults in our words."""

from __future__ import annotations

from typing import Annotated, Any, Literal

from pydantic import BaseModel, ConfigDict, Field, ValidationError

from dmoc.errors import Fault
from dmoc.input_file import YamlTree, field_name

Number = Annotated[float, Field(allow_inf_nan=False)]
Length = Annotated[float, Field(allow_inf_nan=False, gt=0, le=100)]
Metre = Annotated[float, Field(allow_inf_nan=False, ge=-100, le=100)]
Weight = Annotated[float, Field(allow_inf_nan=False, ge=0, le=1e6)]
Position = Annotated[list[Metre], Field(min_length=3, max_length=3)]
Direction = Annotated[list[Number], Field(min_length=3, max_length=3)]
Quaternion = Annotated[list[Number], Field(min_length=4, max_length=4)]
Name = Annotated[str, Field(min_length=1, max_length=80, pattern=r"^[A-Za-z0-9_.-]+$")]
Pair = Annotated[list[str], Field(min_length=2, max_length=2)]
Unit = Literal["m", "mm"]


class _Entry(BaseModel):
    model_config = ConfigDict(extra="forbid", strict=True, frozen=True)


class PoseEntry(_Entry):
    """T_parent_child: position [m] and quaternion (x, y, z, w)."""

    position_m: Position = [0.0, 0.0, 0.0]
    quaternion_xyzw: Quaternion = [0.0, 0.0, 0.0, 1.0]


class RobotEntry(_Entry):
    """A robot of the package (`model`) or a URDF beside the station (`urdf`), and its base.

    `q_lower_rad` and `q_upper_rad` narrow the joint limits in this station (hoses, dress pack).
    `mass_scale` and `torque_scale` multiply the links' masses and the torque limits: the what-if
    of a heavier arm.
    """

    model: str | None = None
    urdf: str | None = None
    base: PoseEntry = PoseEntry()
    q_lower_rad: list[Number] | None = None
    q_upper_rad: list[Number] | None = None
    mass_scale: Annotated[float, Field(allow_inf_nan=False, gt=0, le=10)] = 1.0
    torque_scale: Annotated[float, Field(allow_inf_nan=False, gt=0, le=10)] = 1.0


class ShapeEntry(_Entry):
    """One primitive of the tool, in the flange frame. `touches`: the part that meets the weld."""

    name: Name
    box_m: Annotated[list[Length], Field(min_length=3, max_length=3)] | None = None
    cylinder_m: Annotated[list[Length], Field(min_length=2, max_length=2)] | None = None
    sphere_m: Length | None = None
    pose: PoseEntry = PoseEntry()
    touches: bool = False


class ToolEntry(_Entry):
    """What hangs on the flange. The tip's +Z points into the part; inertia is about `com_m`."""

    mesh: str | None = None
    unit: Unit | None = None
    shapes: list[ShapeEntry] | None = None
    mass_kg: Annotated[float, Field(allow_inf_nan=False, ge=0, le=5000)] = 0.0
    com_m: Position = [0.0, 0.0, 0.0]
    inertia_kg_m2: Annotated[
        list[Annotated[list[Number], Field(min_length=3, max_length=3)]],
        Field(min_length=3, max_length=3),
    ] = [[0.0, 0.0, 0.0], [0.0, 0.0, 0.0], [0.0, 0.0, 0.0]]
    tip: PoseEntry = PoseEntry()
    tip_length_m: Length = 0.05


class ObstacleEntry(_Entry):
    """A mesh (with unit, optionally with authored convex pieces that cover it) or a primitive."""

    name: Name
    mesh: str | None = None
    unit: Unit | None = None
    pieces: str | None = None
    box_m: Annotated[list[Length], Field(min_length=3, max_length=3)] | None = None
    cylinder_m: Annotated[list[Length], Field(min_length=2, max_length=2)] | None = None
    sphere_m: Length | None = None
    pose: PoseEntry = PoseEntry()


class DepartureEntry(_Entry):
    """How the gun leaves a weld unless `studs.csv` says otherwise."""

    direction: Literal["normal"] | Direction = "normal"
    length_m: Annotated[float, Field(allow_inf_nan=False, gt=0, le=1)] = 0.03
    stray_m: Annotated[float, Field(allow_inf_nan=False, gt=0, le=0.05)] = 0.005


class CostEntry(_Entry):
    """Weights of J = ∫ time + effort uᵀu + velocity q̇ᵀq̇ dt; time or effort must be above zero."""

    time: Weight = 1.0
    effort: Weight = 1e-6
    velocity: Weight = 1.0


class StationFile(_Entry):
    """station.yaml, schema version 1. Paths are relative to the file and inside its folder.

    `srdf` names a file whose `disable_collisions` add to `allowed_collisions`; `engine` is what
    measures distances (`native` unless you want a second opinion).
    """

    schema_version: Literal[1]
    name: Name
    robot: RobotEntry
    tool: ToolEntry
    studs: str
    payload_kg: Annotated[float, Field(allow_inf_nan=False, ge=0, le=5000)] = 0.0
    obstacles: list[ObstacleEntry] = []
    spin_steps: Annotated[int, Field(ge=1, le=360)] = 12
    departure: DepartureEntry = DepartureEntry()
    home_rad: list[Number] | None = None
    clearance_m: Annotated[float, Field(allow_inf_nan=False, ge=0, le=0.5)] = 0.02
    cost: CostEntry = CostEntry()
    precedence: list[Pair] = []
    allowed_collisions: list[Pair] = []
    srdf: str | None = None
    engine: Literal["native", "coal", "fcl"] = "native"


def station_schema() -> dict[str, Any]:
    """The JSON Schema of station.yaml (draft 2020-12)."""
    schema = StationFile.model_json_schema()
    return {"$schema": "https://json-schema.org/draft/2020-12/schema", **schema}


_WORDS = {
    "missing": ("field-missing", "a value", "add the field"),
    "extra_forbidden": ("field-unknown", "the fields of the schema", "remove it or mend its name"),
    "finite_number": ("number-not-finite", "a finite number", "write a number"),
    "literal_error": ("value-illegal", "", "write one of the legal values"),
    "bool_type": ("type", "true or false", "write true or false"),
    "int_type": ("type", "a whole number", "write a whole number"),
    "float_type": ("type", "a number", "write a number without quotes"),
    "string_type": ("type", "text", "write text, in quotes if it looks like a number"),
    "list_type": ("type", "a list [..]", "write a list"),
    "model_type": ("type", "a mapping (key: value)", "write key: value lines"),
    "string_pattern_mismatch": ("name", "letters, digits, _ . -", "rename it"),
    "too_short": ("length", "", "give that many entries"),
    "too_long": ("length", "", "give that many entries"),
}


#: pydantic's limits (keys of an error's context) in our notation.
_LIMITS = {"ge": ">=", "gt": ">", "le": "<=", "lt": "<"}


def _legal(item: Any) -> str:
    """The legal range of one complaint, without pydantic's "Input should be"."""
    context = item.get("ctx", {})
    for key, sign in _LIMITS.items():
        if key in context:
            return f"{sign} {context[key]:g}"
    if "expected" in context:
        return str(context["expected"]).replace("'", "")
    if "min_length" in context or "max_length" in context:
        return f"{context.get('min_length', context.get('max_length'))} entries"
    return str(item["msg"])


def faults_of(error: ValidationError, tree: YamlTree, file: str) -> list[Fault]:
    """pydantic's complaints as faults with file, line, field, value, legal range and fix."""
    faults = []
    for item in error.errors(include_url=False):
        # pydantic adds the name of a union's branch to the path; keep what the file has.
        path: list[str | int] = []
        here: Any = tree.data
        for part in item["loc"]:
            if isinstance(here, dict) and (part in here or item["type"] == "missing"):
                path.append(part)
                here = here.get(part)
            elif isinstance(here, list) and isinstance(part, int):
                path.append(part)
                here = here[part] if part < len(here) else None
        code, legal, fix = _WORDS.get(item["type"], ("value-range", "", "give a legal value"))
        legal = legal or _legal(item)
        value = "nothing" if item["type"] == "missing" else repr(item["input"])[:80]
        faults.append(
            Fault(
                code,
                file=file,
                line=tree.line(tuple(path)),
                field=field_name(tuple(path)),
                value=value,
                legal=legal,
                fix=fix,
            )
        )
    return faults
