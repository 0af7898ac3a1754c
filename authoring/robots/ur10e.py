"""A UR10e-class arm: published kinematics, masses and centres of mass, own shapes.

All link frames are parallel to the base at q = 0 (arm stretched along −x); joint axes and offsets
reproduce the published Denavit–Hartenberg table exactly. Inertia is that of a box around the link.
"""

from __future__ import annotations

import numpy as np

from authoring.robots.spec import JointSpec, LinkSpec, Solid, box_inertia

#: Rows (a [m], d [m], alpha [rad]) of the published table.
DH = (
    (0.0, 0.1807, np.pi / 2),
    (-0.6127, 0.0, 0.0),
    (-0.57155, 0.0, 0.0),
    (0.0, 0.17415, np.pi / 2),
    (0.0, 0.11985, -np.pi / 2),
    (0.0, 0.11655, 0.0),
)

_TURN = 2 * np.pi
_MINUS_Y, _MINUS_Z = (0.0, -1.0, 0.0), (0.0, 0.0, -1.0)
_SLOW, _FAST = np.deg2rad([120.0, 180.0])
JOINTS = (
    JointSpec("joint_1", (0, 0, 0.1807), (0, 0, 1), -_TURN, _TURN, _SLOW, 330),
    JointSpec("joint_2", (0, 0, 0), _MINUS_Y, -_TURN, _TURN, _SLOW, 330),
    JointSpec("joint_3", (-0.6127, 0, 0), _MINUS_Y, -np.pi, np.pi, _FAST, 150),
    JointSpec("joint_4", (-0.57155, -0.17415, 0), _MINUS_Y, -_TURN, _TURN, _FAST, 56),
    JointSpec("joint_5", (0, 0, 0), _MINUS_Z, -_TURN, _TURN, _FAST, 56),
    JointSpec("joint_6", (0, -0.11655, -0.11985), _MINUS_Y, -_TURN, _TURN, _FAST, 56),
)

LINKS = (
    LinkSpec(
        "base_link",
        4.0,
        (0, 0, 0.05),
        box_inertia(4.0, 0.19, 0.19, 0.1),
        (Solid("cylinder", (0.075, 0.085), (0, 0, 0.0425), colour="dark"),),
    ),
    LinkSpec(
        "link_1",
        7.369,
        (0.021, -0.027, 0),
        box_inertia(7.369, 0.16, 0.20, 0.17),
        (
            Solid("cylinder", (0.08, 0.17), (0, 0, 0), colour="light"),
            Solid("cylinder", (0.08, 0.16), (0, -0.02, 0), "y", "light"),
        ),
    ),
    LinkSpec(
        "link_2",
        13.051,
        (-0.2327, -0.158, 0),
        box_inertia(13.051, 0.77, 0.16, 0.16),
        (
            Solid("cylinder", (0.08, 0.15), (0, -0.176, 0), "y", "light"),
            Solid("cylinder", (0.06, 0.6127), (-0.30635, -0.176, 0), "x", "light"),
            Solid("cylinder", (0.07, 0.12), (-0.6127, -0.165, 0), "y", "light"),
        ),
    ),
    LinkSpec(
        "link_3",
        3.989,
        (-0.33155, -0.068, 0),
        box_inertia(3.989, 0.66, 0.12, 0.12),
        (
            Solid("cylinder", (0.065, 0.11), (0, -0.045, 0), "y", "light"),
            Solid("cylinder", (0.05, 0.57155), (-0.285775, -0.045, 0), "x", "light"),
            Solid("cylinder", (0.055, 0.10), (-0.57155, -0.055, 0), "y", "light"),
        ),
    ),
    LinkSpec(
        "link_4",
        2.1,
        (0, -0.007, -0.018),
        box_inertia(2.1, 0.1, 0.11, 0.12),
        (Solid("cylinder", (0.05, 0.11), (0, 0, -0.005), "y", "light"),),
    ),
    LinkSpec(
        "link_5",
        1.98,
        (0, -0.018, -0.11285),
        box_inertia(1.98, 0.1, 0.11, 0.12),
        (
            Solid("cylinder", (0.045, 0.11), (0, 0, -0.115), "z", "light"),
            Solid("cylinder", (0.045, 0.06), (0, -0.01, -0.11985), "y", "light"),
        ),
    ),
    LinkSpec(
        "link_6",
        0.615,
        (0, 0.026, 0),
        box_inertia(0.615, 0.09, 0.05, 0.09),
        (Solid("cylinder", (0.045, 0.06), (0, 0.03, 0), "y", "dark"),),
    ),
)
