"""How a controller counts the joints of a URDF: signs, offsets, the coupling of axes 2 and 3."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt
import pinocchio as pin

from dmoc.arrays import Array
from dmoc.errors import Fault, RobotError

#: `any`: a robot of no vendor, whose angles every controller is told as they are.
VENDORS = ("abb", "kuka", "ur", "fanuc", "yaskawa", "any")
#: c of J3 = q3 + c J2: how far axis 3 turns with axis 2.
COUPLINGS = {"none": 0.0, "plus_axis_2": 1.0, "minus_axis_2": -1.0}
_KEYS = ("vendor", "sign", "offset_deg", "coupling", "base", "tool0", "home", "limits_deg")
#: The stated home may be off by what a pendant rounds away.
HOME_DEG = 0.05
_LIMIT_DEG = 0.1


@dataclass(frozen=True, eq=False)
class Controller:
    """Controller angles [deg] = sign · URDF angles + offset, axis 3 plus `coupling` · axis 2.

    A joint that slides (`slides` (n,)) counts in mm, and not among the axes of the coupling.
    `base` is T_base_link_controller, `tool0` T_flange_tool0; `home` one pose in both notations
    (URDF [rad], controller [deg]) and `limits_deg` (n, 2) the axis ranges of the data sheet, each
    None where it is not given.
    """

    vendor: str
    sign: Array
    offset_deg: Array
    coupling: float
    base: pin.SE3
    tool0: pin.SE3
    home: tuple[Array, Array] | None
    limits_deg: Array | None
    slides: npt.NDArray[np.bool_]

    def degrees(self, q_rad: Array) -> Array:
        """Controller angles [deg] of URDF angles (..., n) [rad]."""
        angles = self._apart(q_rad)
        if self.coupling:
            two, three = np.flatnonzero(~self.slides)[1:3]
            angles[..., three] += self.coupling * angles[..., two]
        return angles

    def radians(self, degrees: Array) -> Array:
        """URDF angles [rad] of controller angles (..., n) [deg]."""
        angles = np.array(degrees, dtype=float)
        if self.coupling:
            two, three = np.flatnonzero(~self.slides)[1:3]
            angles[..., three] -= self.coupling * angles[..., two]
        return self.sign * (angles - self.offset_deg) / self._unit()

    def _apart(self, q_rad: Array) -> Array:
        """As `degrees`, without the coupling."""
        angles: Array = self.sign * np.asarray(q_rad) * self._unit() + self.offset_deg
        return angles

    def _unit(self) -> Array:
        return np.where(self.slides, 1000.0, np.degrees(1.0))

    def home_error_deg(self) -> float:
        """How far the map misses the pose that is stated in both notations; 0 where none is."""
        if self.home is None:
            return 0.0
        return float(np.max(np.abs(self.degrees(self.home[0]) - self.home[1])))

    def doubts(self, file: str, q_lower_rad: Array, q_upper_rad: Array) -> list[Fault]:
        """Warnings: the map misses the stated home; mapped limits reach beyond the data sheet."""
        found = []
        if (error := self.home_error_deg()) > HOME_DEG:
            value = f"the map misses the controller's pose by {error:.3g} deg"
            legal, fix = f"at most {HOME_DEG} deg", "mend sign, offset_deg or coupling"
            found.append(Fault("controller-home", file, "controller.home", value, legal, fix))
        if self.limits_deg is None:
            return found
        ends = [self._apart(q) for q in (q_lower_rad, q_upper_rad)]
        third = np.flatnonzero(~self.slides)[2:3] if self.coupling else ()
        low, high = np.minimum(*ends), np.maximum(*ends)
        for j, (least, most) in enumerate(self.limits_deg):
            apart = max(abs(low[j] - least), abs(high[j] - most))
            if apart <= _LIMIT_DEG or j in third:  # a coupled range is no interval
                continue
            value = f"the URDF's limits are {low[j]:.6g} to {high[j]:.6g} deg there"
            legal = f"{least:.6g} to {most:.6g} deg"
            fix = "where they differ by more than a choice of yours, sign or offset are wrong"
            field = f"controller.limits_deg[{j}]"
            found.append(Fault("controller-limits", file, field, value, legal, fix))
        return found


def controller_from_mapping(
    data: Any, n: int, slides: npt.NDArray[np.bool_] | None = None
) -> Controller:
    """The `controller` section of robot.yaml for n joints; `RobotError` with every fault."""
    slides = np.zeros(n, dtype=np.bool_) if slides is None else slides
    faults: list[Fault] = []

    def refuse(field: str, value: Any, legal: str, fix: str) -> None:
        faults.append(Fault("controller-value", "", f"controller.{field}", str(value), legal, fix))

    def numbers(value: Any, field: str, shape: tuple[int, ...], legal: str) -> Array:
        array = np.array(value) if isinstance(value, (list, np.ndarray)) else np.zeros(0)
        good = array.dtype.kind in "if" and array.shape == shape and np.all(np.abs(array) < 1e4)
        if not good:
            refuse(field, value, legal, "one entry per joint, in the URDF's order")
        return array.astype(float) if good else np.zeros(shape)

    def pose(field: str) -> pin.SE3:
        entry = data.get(field, {})
        if not isinstance(entry, dict) or entry.keys() - {"position_m", "quaternion_xyzw"}:
            refuse(field, entry, "position_m, quaternion_xyzw", "write {position_m: [x, y, z]}")
            return pin.SE3.Identity()
        place = numbers(entry.get("position_m", [0, 0, 0]), field, (3,), "3 numbers [m]")
        turn = numbers(entry.get("quaternion_xyzw", [0, 0, 0, 1]), field, (4,), "x, y, z, w")
        if not 0.99 < np.linalg.norm(turn) < 1.01:
            refuse(field, turn.tolist(), "a quaternion of length 1", "write x, y, z, w")
            return pin.SE3.Identity()
        return pin.SE3(pin.Quaternion(turn).normalized().matrix(), place)

    if not isinstance(data, dict):
        data = {"vendor": data}
    for key in sorted(map(str, data.keys() - set(_KEYS))):
        refuse(key, data.get(key), ", ".join(_KEYS), "remove it or mend the spelling")
    vendor, coupling = data.get("vendor"), data.get("coupling")
    if vendor not in VENDORS:
        refuse("vendor", vendor, ", ".join(VENDORS), "name the vendor of the controller")
    # yaml reads a bare none as text; nothing said is not "none".
    if not isinstance(coupling, str) or coupling not in COUPLINGS:
        fix = "say whether axis 3 turns with axis 2 (rods of ABB, FANUC), even where it does not"
        refuse("coupling", coupling, ", ".join(COUPLINGS), fix)
    elif coupling != "none" and np.sum(~slides) < 3:
        refuse("coupling", coupling, "none for fewer than 3 joints", "write none")
    sign = numbers(data.get("sign", [1] * n), "sign", (n,), f"{n} of 1 and -1")
    if not np.all(np.abs(sign) == 1):
        refuse("sign", sign.tolist(), f"{n} of 1 and -1", "one entry per joint")
    offset = numbers(data.get("offset_deg", [0] * n), "offset_deg", (n,), f"{n} angles [deg]")
    home, legal = None, "urdf_deg and controller_deg"
    if (given := data.get("home")) is not None:
        if not isinstance(given, dict) or given.keys() != {"urdf_deg", "controller_deg"}:
            refuse("home", given, legal, "one pose in both notations")
        else:
            urdf, own = (
                numbers(given[key], f"home.{key}", (n,), f"{n} angles [deg]")
                for key in ("urdf_deg", "controller_deg")
            )
            home = (np.where(slides, urdf / 1000.0, np.radians(urdf)), own)
    limits = data.get("limits_deg")
    if limits is not None:
        limits = numbers(limits, "limits_deg", (n, 2), f"{n} pairs [least, most] [deg]")
    base, tool0 = pose("base"), pose("tool0")
    if faults:
        raise RobotError(faults)
    turns = COUPLINGS[coupling]
    return Controller(vendor, sign, offset, turns, base, tool0, home, limits, slides)


def controller_text(num_joints: int) -> str:
    """The section for a robot.yaml that has none, as comments: what it holds and what is legal."""
    ones, zeros = ", ".join(["1"] * num_joints), ", ".join(["0"] * num_joints)
    return f"""\
# What the controller calls the joints; export needs it. The map belongs to this URDF and model, not
# to the vendor: controller angle = sign * URDF angle + offset_deg; with coupling plus_axis_2 or
# minus_axis_2 (rods of ABB and FANUC arms) axis 3 counts from axis 2. vendor: {", ".join(VENDORS)}.
# controller:
#   vendor: abb
#   sign: [{ones}]
#   offset_deg: [{zeros}]
#   coupling: none
#   # Optional: one pose read off the pendant, and the data sheet's ranges, to prove the map;
#   # base (T_base_link_controller) and tool0 (T_flange_tool0), position_m and quaternion_xyzw.
#   # home: {{urdf_deg: [{zeros}], controller_deg: [{zeros}]}}
#   # limits_deg: [[-170, 170], one pair per joint]
"""
