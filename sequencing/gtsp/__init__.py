"""Generalised travelling salesman: one node of every cluster, in the cheapest order.

Importing costs nothing: numba and the kernels are loaded at the first `solve`.
"""

from sequencing.gtsp.file_report import run_gtsp_file
from sequencing.gtsp.graphs import problem_from_graph, problem_to_graph, tour_to_graph
from sequencing.gtsp.gtsplib import read_gtsplib, write_gtsplib
from sequencing.gtsp.held_karp_table import held_karp_memory_bytes
from sequencing.gtsp.portfolio import solve
from sequencing.gtsp.problem import GtspProblem, Tour
from sequencing.gtsp.stop import Incumbent, Stop

__all__ = [
    "GtspProblem",
    "Incumbent",
    "Stop",
    "Tour",
    "held_karp_memory_bytes",
    "problem_from_graph",
    "problem_to_graph",
    "read_gtsplib",
    "run_gtsp_file",
    "solve",
    "tour_to_graph",
    "write_gtsplib",
]
