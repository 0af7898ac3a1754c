from .alternatives_search import alternatives as alternatives
from .certificate import certify as certify
from .check import check_station as check_station
from .edge_clearance import DepartureLine as DepartureLine
from .edge_motion import plan_motion as plan_motion
from .roadmap import plan_path as plan_path
from .station import (
    Station as Station,
)
from .station import (
    Stud as Stud,
)
from .station import (
    demo_station as demo_station,
)
from .station import (
    load_station as load_station,
)
from .world import CollisionWorld as CollisionWorld
