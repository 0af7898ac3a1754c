from .batch import solve_many as solve_many
from .cost import Cost as Cost
from .cost import ElectricalCost as ElectricalCost
from .errors import DmocError as DmocError
from .motion import (
    Motion as Motion,
)
from .motion import (
    MotionNotSolved as MotionNotSolved,
)
from .motion import (
    MotionProblem as MotionProblem,
)
from .refinement import refine as refine
from .resimulation import replay_motion as replay_motion
from .robot import Robot as Robot
from .robot import load_robot as load_robot
from .solver import solve as solve
from .status import Status as Status
from .trajectory import JointPath as JointPath
from .trajectory import JointTrajectory as JointTrajectory
