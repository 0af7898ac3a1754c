"""A pinocchio arm as a MuJoCo model: an independent simulator for replays."""

import mujoco
import numpy as np
import pinocchio as pin


def mujoco_model(model: pin.Model, timestep: float) -> mujoco.MjModel:
    """Same joints, inertias, armature and gravity; no contacts, no damping, RK4."""
    spec = mujoco.MjSpec()
    spec.option.timestep = timestep
    spec.option.integrator = mujoco.mjtIntegrator.mjINT_RK4
    spec.option.gravity = np.array(model.gravity.linear)
    spec.option.disableflags = mujoco.mjtDisableBit.mjDSBL_CONTACT
    bodies = [spec.worldbody]
    for i in range(1, model.njoints):
        name = model.joints[i].shortname().removeprefix("JointModel")
        if name == "RevoluteUnaligned":
            axis = np.array(model.joints[i].extract().axis)
        else:
            assert name in ("RX", "RY", "RZ"), name
            axis = np.eye(3)["XYZ".index(name[1])]
        place, inertia = model.jointPlacements[i], model.inertias[i]
        body = bodies[model.parents[i]].add_body(pos=place.translation, quat=_wxyz(place.rotation))
        # MuJoCo wants principal axes of inertia, right-handed.
        values, axes = np.linalg.eigh(inertia.inertia)
        axes[:, 0] *= np.sign(np.linalg.det(axes))
        body.mass, body.ipos = float(inertia.mass), inertia.lever
        body.inertia, body.iquat = values, _wxyz(axes)
        body.explicitinertial = True
        hinge = mujoco.mjtJoint.mjJNT_HINGE
        body.add_joint(type=hinge, axis=axis, armature=float(model.armature[i - 1]))
        bodies.append(body)
    return spec.compile()


def _wxyz(rotation: np.ndarray) -> np.ndarray:
    x, y, z, w = pin.Quaternion(np.array(rotation)).coeffs()
    return np.array([w, x, y, z])
