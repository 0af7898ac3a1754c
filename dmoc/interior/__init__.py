"""An interior-point method made for the programme of a motion.

The Newton system of the knots, torques and momentum rows is factorised by a Riccati recursion over
the stages (`riccati_kernels`), with the free step h as its border; stage functions write their
derivatives where it reads them (`oracle`, `frames`). What does not fit in one stage's frame (RMS
torque, a free last velocity, rows with equal bounds beside the momenta) is not for it.
"""

from __future__ import annotations

from dmoc.interior.adapter import solve_structured

__all__ = ["solve_structured"]
