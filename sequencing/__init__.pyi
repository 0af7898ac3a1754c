from .cycle.plan import PlanStop as PlanStop
from .cycle.plan import plan_station as plan_station
from .cycle_types import Cycle as Cycle
from .edges.store import EdgeStore as EdgeStore
from .runs.folder import read_run as read_run
from .runs.folder import write_run as write_run
from .timing import schedule as schedule
