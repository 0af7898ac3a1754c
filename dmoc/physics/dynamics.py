r"""Rigid-body dynamics of a fixed-base tree of one-axis joints, for CasADi symbols.

`pinocchio.casadi` is not in the wheel, so the two recursions that optimal control needs are written
here on 3-vectors. With v_i = (v, w) the spatial velocity of body i in its own frame, F_i = (l, n)
the spatial momentum of the whole subtree at the origin of that frame and S_i the joint axis:

.. math:: p_i = \partial T/\partial\dot q_i = S_i \cdot F_i, \qquad
          \partial T/\partial q_i = (v_i \times S_i) \cdot F_i,

which is Featherstone's momentum recursion with one extra product per joint. Rotor armature A adds
A q̇ to the momentum. Checked against `pinocchio` in the tests.
"""

from __future__ import annotations

import hashlib
from dataclasses import dataclass
from typing import Any

import casadi as ca
import numpy as np
import pinocchio as pin

from dmoc.errors import Fault, RobotError

_AXES = {"X": (1.0, 0.0, 0.0), "Y": (0.0, 1.0, 0.0), "Z": (0.0, 0.0, 1.0)}


@dataclass(frozen=True)
class Joint:
    """One moving body: its axis and, in plain tuples, all numbers of its inertia.

    `rotation` (9,) row-major and `offset_m` (3,) place the joint frame in the parent body's frame
    at q = 0; `axis` (3,) is a unit vector; `first_moment` (3,) is mass times centre of mass [kg·m]
    and `inertia` (9,) row-major the rotational inertia about the frame's origin [kg·m²].
    """

    parent: int
    revolute: bool
    axis: tuple[float, ...]
    rotation: tuple[float, ...]
    offset_m: tuple[float, ...]
    mass_kg: float
    first_moment: tuple[float, ...]
    inertia: tuple[float, ...]
    armature: float


@dataclass(frozen=True)
class ArmModel:
    """A tree of `Joint`s, gravity (3,) [m/s²] and where an external wrench acts.

    `wrench_joint` is the index of the body that carries the point `wrench_point_m` (3,).
    """

    joints: tuple[Joint, ...]
    gravity: tuple[float, ...]
    wrench_joint: int
    wrench_point_m: tuple[float, ...]

    @property
    def num_joints(self) -> int:
        """n."""
        return len(self.joints)

    @property
    def fingerprint(self) -> str:
        """sha256 over every number of the model."""
        return hashlib.sha256(repr(self).encode()).hexdigest()


def _axis(joint: Any) -> tuple[bool, tuple[float, ...]] | None:
    name = joint.shortname()
    stem = name.removeprefix("JointModel")
    if stem in ("RX", "RY", "RZ", "PX", "PY", "PZ"):
        return stem[0] == "R", _AXES[stem[1]]
    if stem in ("RevoluteUnaligned", "PrismaticUnaligned"):
        return stem[0] == "R", tuple(float(x) for x in joint.extract().axis)
    return None


def arm_model(
    model: pin.Model, wrench_joint: int | None = None, wrench_point_m: Any = (0.0, 0.0, 0.0)
) -> ArmModel:
    """The numbers of a `pin.Model` with revolute and prismatic joints (armature included).

    Raises `RobotError` for any other joint (continuous joints need limits in the URDF).
    """
    joints, faults = [], []
    for i in range(1, model.njoints):
        kind = _axis(model.joints[i])
        if kind is None:
            faults.append(
                Fault(
                    "joint-kind",
                    field=str(model.names[i]),
                    value=model.joints[i].shortname(),
                    legal="revolute or prismatic, one axis",
                    fix="give the joint limits (type revolute) or merge it into its parent",
                )
            )
            continue
        placement, body = model.jointPlacements[i], model.inertias[i]
        mass, lever = float(body.mass), np.array(body.lever)
        about_origin = np.array(body.inertia) + mass * (
            lever @ lever * np.eye(3) - np.outer(lever, lever)
        )
        joints.append(
            Joint(
                parent=int(model.parents[i]) - 1,
                revolute=kind[0],
                axis=kind[1],
                rotation=_floats(placement.rotation),
                offset_m=_floats(placement.translation),
                mass_kg=mass,
                first_moment=_floats(mass * lever),
                inertia=_floats(about_origin),
                armature=float(model.armature[model.joints[i].idx_v]),
            )
        )
    if faults:
        raise RobotError(faults)
    last = len(joints) - 1 if wrench_joint is None else wrench_joint
    return ArmModel(tuple(joints), _floats(model.gravity.linear), last, _floats(wrench_point_m))


def _floats(values: Any) -> tuple[float, ...]:
    return tuple(float(x) + 0.0 for x in np.asarray(values, dtype=float).ravel())


def _matrix(row_major: tuple[float, ...]) -> ca.DM:
    return ca.sparsify(ca.DM(np.array(row_major).reshape(3, 3)))


def _column(values: tuple[float, ...]) -> ca.DM:
    return ca.DM(np.array(values))


def _cross(a: Any, b: Any) -> Any:
    a, b = ca.densify(a), ca.densify(b)
    return ca.vertcat(
        a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]
    )


def _rotation(joint: Joint, q: Any) -> Any:
    """Rotation of the body frame in the parent frame, (3, 3)."""
    fixed = _matrix(joint.rotation)
    if not joint.revolute:
        return fixed
    x, y, z = joint.axis
    c, s = ca.cos(q), ca.sin(q)
    skew = ca.DM([[0, -z, y], [z, 0, -x], [-y, x, 0]])
    outer = ca.DM(np.outer(joint.axis, joint.axis))
    # c·I + s·[a]× + (1−c)·a aᵀ; for a coordinate axis the products with 0 vanish while building.
    turn = c * (ca.DM.eye(3) - outer) + s * skew + outer
    return ca.mtimes(fixed, turn)


def _offset(joint: Joint, q: Any) -> Any:
    offset = _column(joint.offset_m)
    if joint.revolute:
        return offset
    return offset + ca.mtimes(_matrix(joint.rotation), _column(joint.axis)) * q


def lagrangian_gradients(arm: ArmModel, q: Any, v: Any, wrench: Any = None) -> tuple[Any, Any]:
    """(p, f): momentum p = M(q) v and generalised force f = ∂T/∂q − ∂V/∂q (+ Jᵀw), each (n, 1).

    `q` [rad], `v` [rad/s] are CasADi columns (n, 1); `wrench` (6, 1), if given, is a force [N] and
    a moment [N·m] in world axes at the arm's wrench point. One sweep out, one back: about 370
    operations for six joints.
    """
    n = arm.num_joints
    turns = [_rotation(joint, q[i]) for i, joint in enumerate(arm.joints)]
    offsets = [_offset(joint, q[i]) for i, joint in enumerate(arm.joints)]
    linear: list[Any] = [None] * n
    angular: list[Any] = [None] * n
    gravity: list[Any] = [None] * n
    still = ca.DM.zeros(3)
    for i, joint in enumerate(arm.joints):
        root = joint.parent < 0
        vp = still if root else linear[joint.parent]
        wp = still if root else angular[joint.parent]
        gp = _column(arm.gravity) if root else gravity[joint.parent]
        back = turns[i].T
        axis = _column(joint.axis) * v[i]
        lever = still if root else _cross(wp, offsets[i])
        linear[i] = ca.mtimes(back, vp + lever)
        angular[i] = ca.mtimes(back, wp)
        gravity[i] = ca.mtimes(back, gp)
        if joint.revolute:
            angular[i] = angular[i] + axis
        else:
            linear[i] = linear[i] + axis
    # Momentum (l, m) and gravity wrench (f, k) of every body, summed up on the way back.
    push: list[Any] = []
    spin: list[Any] = []
    force: list[Any] = []
    moment: list[Any] = []
    for i, joint in enumerate(arm.joints):
        first = _column(joint.first_moment)
        push.append(joint.mass_kg * linear[i] + _cross(angular[i], first))
        spin.append(ca.mtimes(_matrix(joint.inertia), angular[i]) + _cross(first, linear[i]))
        force.append(joint.mass_kg * gravity[i])
        moment.append(_cross(first, gravity[i]))
    if wrench is not None:
        f, m = _wrench_in_body(arm, turns, wrench)
        force[arm.wrench_joint] += f
        moment[arm.wrench_joint] += m
    p: list[Any] = [None] * n
    rate: list[Any] = [None] * n
    for i in reversed(range(n)):
        joint, axis = arm.joints[i], _column(arm.joints[i].axis)
        drag = ca.dot(_cross(angular[i], axis), spin[i] if joint.revolute else push[i])
        if joint.revolute:
            p[i] = ca.dot(axis, spin[i])
            rate[i] = drag + ca.dot(_cross(linear[i], axis), push[i]) + ca.dot(axis, moment[i])
        else:
            p[i] = ca.dot(axis, push[i])
            rate[i] = drag + ca.dot(axis, force[i])
        p[i] = p[i] + joint.armature * v[i]
        if joint.parent >= 0:
            for lin, ang in ((push, spin), (force, moment)):
                turned = ca.mtimes(turns[i], lin[i])
                lin[joint.parent] += turned
                ang[joint.parent] += ca.mtimes(turns[i], ang[i]) + _cross(offsets[i], turned)
    return ca.vertcat(*p), ca.vertcat(*rate)


def _wrench_in_body(arm: ArmModel, turns: list[Any], wrench: Any) -> tuple[Any, Any]:
    """The external wrench about the origin, and in the axes, of the body that carries it."""
    chain, i = [], arm.wrench_joint
    while i >= 0:
        chain.append(i)
        i = arm.joints[i].parent
    force, moment = wrench[:3], wrench[3:]
    for i in reversed(chain):
        force, moment = ca.mtimes(turns[i].T, force), ca.mtimes(turns[i].T, moment)
    return force, moment + _cross(_column(arm.wrench_point_m), force)


def inverse_dynamics(arm: ArmModel, q: Any, v: Any, a: Any, wrench: Any = None) -> Any:
    """τ (n, 1) [N·m] of the recursive Newton–Euler algorithm, armature included.

    `q`, `v`, `a` are CasADi columns (n, 1); what an external `wrench` (6, 1) gives already (see
    `lagrangian_gradients`) is not in τ. Source: Featherstone, Rigid Body Dynamics Algorithms,
    table 5.1; gravity enters as an acceleration of the base.
    """
    n = arm.num_joints
    turns = [_rotation(joint, q[i]) for i, joint in enumerate(arm.joints)]
    offsets = [_offset(joint, q[i]) for i, joint in enumerate(arm.joints)]
    w: list[Any] = []
    alpha: list[Any] = []
    acc: list[Any] = []
    for i, joint in enumerate(arm.joints):
        root = joint.parent < 0
        zero = ca.DM.zeros(3)
        wp, ap = (zero, zero) if root else (w[joint.parent], alpha[joint.parent])
        xp = -_column(arm.gravity) if root else acc[joint.parent]
        back, r, axis = turns[i].T, offsets[i], _column(joint.axis)
        wi, ai = ca.mtimes(back, wp), ca.mtimes(back, ap)
        point = xp + _cross(ap, r) + _cross(wp, _cross(wp, r))
        xi = ca.mtimes(back, point)
        if joint.revolute:
            ai = ai + axis * a[i] + _cross(wi, axis * v[i])
            wi = wi + axis * v[i]
        else:
            xi = xi + axis * a[i] + 2 * _cross(wi, axis * v[i])
        w.append(wi)
        alpha.append(ai)
        acc.append(xi)
    force, moment = [], []
    for i, joint in enumerate(arm.joints):
        first, inertia = _column(joint.first_moment), _matrix(joint.inertia)
        force.append(
            joint.mass_kg * acc[i] + _cross(alpha[i], first) + _cross(w[i], _cross(w[i], first))
        )
        moment.append(
            ca.mtimes(inertia, alpha[i])
            + _cross(w[i], ca.mtimes(inertia, w[i]))
            + _cross(first, acc[i])
        )
    if wrench is not None:
        f, m = _wrench_in_body(arm, turns, wrench)
        force[arm.wrench_joint] -= f
        moment[arm.wrench_joint] -= m
    tau: list[Any] = [None] * n
    for i in reversed(range(n)):
        joint, axis = arm.joints[i], _column(arm.joints[i].axis)
        tau[i] = ca.dot(axis, moment[i] if joint.revolute else force[i]) + joint.armature * a[i]
        if joint.parent >= 0:
            turned = ca.mtimes(turns[i], force[i])
            force[joint.parent] += turned
            moment[joint.parent] += ca.mtimes(turns[i], moment[i]) + _cross(offsets[i], turned)
    return ca.vertcat(*tau)
