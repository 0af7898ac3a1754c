from .cycle import PlanStop as PlanStop
from .cycle import plan_station as plan_station
from .cycle_types import Cycle as Cycle
from .run_files import read_run as read_run
from .run_files import write_run as write_run
from .store import EdgeStore as EdgeStore
from .timing import schedule as schedule
