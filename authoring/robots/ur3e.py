"""A UR3e-class arm: published kinematics, masses, centres of mass and moments, own shapes.

All link frames are parallel to the base at q = 0 (arm stretched along −x); joint axes and offsets
reproduce the published Denavit–Hartenberg table exactly. Of the published inertia tensors the
diagonal is kept (products of inertia are below 4 % of it).
"""

from __future__ import annotations

import numpy as np

from authoring.robots.spec import JointSpec, LinkSpec, Solid, box_inertia

#: Rows (a [m], d [m], alpha [rad]) of the published table.
DH = (
    (0.0, 0.15185, np.pi / 2),
    (-0.24355, 0.0, 0.0),
    (-0.2132, 0.0, 0.0),
    (0.0, 0.13105, np.pi / 2),
    (0.0, 0.08535, -np.pi / 2),
    (0.0, 0.0921, 0.0),
)

_TURN = 2 * np.pi
_MINUS_Y, _MINUS_Z = (0.0, -1.0, 0.0), (0.0, 0.0, -1.0)
_SLOW, _FAST = np.deg2rad([180.0, 360.0])
JOINTS = (
    JointSpec("joint_1", (0, 0, 0.15185), (0, 0, 1), -_TURN, _TURN, _SLOW, 56),
    JointSpec("joint_2", (0, 0, 0), _MINUS_Y, -_TURN, _TURN, _SLOW, 56),
    JointSpec("joint_3", (-0.24355, 0, 0), _MINUS_Y, -np.pi, np.pi, _SLOW, 28),
    JointSpec("joint_4", (-0.2132, -0.13105, 0), _MINUS_Y, -_TURN, _TURN, _FAST, 12),
    JointSpec("joint_5", (0, 0, 0), _MINUS_Z, -_TURN, _TURN, _FAST, 12),
    JointSpec("joint_6", (0, -0.0921, -0.08535), _MINUS_Y, -_TURN, _TURN, _FAST, 12),
)

LINKS = (
    LinkSpec(
        "base_link",
        2.0,
        (0, 0, 0.03),
        box_inertia(2.0, 0.13, 0.13, 0.06),
        (Solid("cylinder", (0.064, 0.06), (0, 0, 0.03), colour="dark"),),
    ),
    LinkSpec(
        "link_1",
        1.98,
        (0, 0, -0.02),
        (0.0027657, 0.0025626, 0.0021501),
        (
            Solid("cylinder", (0.055, 0.13), (0, 0, -0.005), colour="light"),
            Solid("cylinder", (0.055, 0.12), (0, -0.01, 0), "y", "light"),
        ),
    ),
    LinkSpec(
        "link_2",
        3.4445,
        (-0.11355, -0.1157, 0),
        (0.0042623, 0.0448947, 0.0460284),
        (
            Solid("cylinder", (0.055, 0.10), (0, -0.12, 0), "y", "light"),
            Solid("cylinder", (0.042, 0.24355), (-0.121775, -0.12, 0), "x", "light"),
            Solid("cylinder", (0.048, 0.085), (-0.24355, -0.112, 0), "y", "light"),
        ),
    ),
    LinkSpec(
        "link_3",
        1.437,
        (-0.1632, -0.0238, 0),
        (0.0010511, 0.0110895, 0.0113396),
        (
            Solid("cylinder", (0.045, 0.08), (0, -0.03, 0), "y", "light"),
            Solid("cylinder", (0.035, 0.2132), (-0.1066, -0.027, 0), "x", "light"),
            Solid("cylinder", (0.038, 0.075), (-0.2132, -0.04, 0), "y", "light"),
        ),
    ),
    LinkSpec(
        "link_4",
        0.871,
        (0, 0, -0.01),
        (0.0008174, 0.0006844, 0.0005497),
        (Solid("cylinder", (0.035, 0.085), (0, 0, -0.004), "y", "light"),),
    ),
    LinkSpec(
        "link_5",
        0.805,
        (0, -0.01, -0.08535),
        (0.0006059, 0.0003831, 0.0005837),
        (
            Solid("cylinder", (0.035, 0.08), (0, 0, -0.082), "z", "light"),
            Solid("cylinder", (0.035, 0.06), (0, -0.015, -0.08535), "y", "light"),
        ),
    ),
    LinkSpec(
        "link_6",
        0.261,
        (0, 0.02, 0),
        (0.000108, 0.0001371, 0.0001086),
        (Solid("cylinder", (0.032, 0.035), (0, 0.02, 0), "y", "dark"),),
    ),
)
