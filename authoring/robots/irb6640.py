"""An IRB 6640-185/2.80-class arm: published kinematics, assumed shapes and inertial values.

Axes Z Y Y X Y X. Link 6's frame, like `flange`, lies in the flange face with x along joint 6.
"""

from __future__ import annotations

import numpy as np

from authoring.robots.spec import JointSpec, LinkSpec, Solid, box_inertia


def _joint(
    number: int,
    origin_m: tuple[float, float, float],
    axis: tuple[float, float, float],
    limits_deg: tuple[float, float],
    speed_deg_s: float,
    effort_nm: float,
) -> JointSpec:
    lower, upper, speed = np.deg2rad([*limits_deg, speed_deg_s])
    return JointSpec(f"joint_{number}", origin_m, axis, lower, upper, speed, effort_nm)


_X, _Y, _Z = (1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0)
JOINTS = (
    _joint(1, (0, 0, 0.78), _Z, (-170, 170), 100, 14000),
    _joint(2, (0.32, 0, 0), _Y, (-65, 85), 90, 18000),
    _joint(3, (0, 0, 1.075), _Y, (-180, 70), 90, 9000),
    _joint(4, (0, 0, 0.2), _X, (-300, 300), 170, 2500),
    _joint(5, (1.392, 0, 0), _Y, (-120, 120), 140, 2500),
    _joint(6, (0.2, 0, 0), _X, (-360, 360), 190, 1400),
)

LINKS = (
    LinkSpec(
        "base_link",
        430,
        (0, 0, 0.2),
        box_inertia(430, 0.78, 0.7, 0.4),
        (
            Solid("box", (0.78, 0.70, 0.08), (0, 0, 0.04), colour="dark"),
            Solid("cylinder", (0.31, 0.32), (0, 0, 0.24), colour="dark"),
        ),
    ),
    LinkSpec(
        "link_1",
        330,
        (0.12, 0, -0.12),
        box_inertia(330, 0.8, 0.7, 0.6),
        (
            Solid("cylinder", (0.34, 0.20), (0, 0, -0.25)),
            Solid("box", (0.64, 0.48, 0.40), (0.16, 0, 0.02)),
        ),
    ),
    LinkSpec(
        "link_2",
        140,
        (0, -0.02, 0.48),
        box_inertia(140, 0.3, 0.25, 1.25),
        (Solid("box", (0.26, 0.25, 1.31), (0, -0.02, 0.5375)),),
    ),
    LinkSpec(
        "link_3",
        310,
        (-0.05, 0, 0.12),
        box_inertia(310, 0.85, 0.55, 0.5),
        (Solid("box", (0.80, 0.46, 0.44), (-0.06, 0, 0.13)),),
    ),
    LinkSpec(
        "link_4",
        85,
        (0.92, 0, 0),
        box_inertia(85, 1.0, 0.25, 0.25),
        (Solid("cylinder", (0.125, 1.06), (0.89, 0, 0), "x"),),
    ),
    LinkSpec(
        "link_5",
        35,
        (0.03, 0, 0),
        box_inertia(35, 0.25, 0.18, 0.22),
        (Solid("cylinder", (0.11, 0.22), (0.01, 0, 0), "x", "dark"),),
    ),
    LinkSpec(
        "link_6",
        9,
        (-0.04, 0, 0),
        box_inertia(9, 0.08, 0.2, 0.2),
        (Solid("cylinder", (0.10, 0.075), (-0.0375, 0, 0), "x", "light"),),
    ),
)
