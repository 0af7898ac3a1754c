"""One motion of one robot: dynamics, optimal control, refinement, drives."""

from __future__ import annotations

import lazy_loader

# The names of `__init__.pyi`, each loaded on first use: importing the package costs nothing.
__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
