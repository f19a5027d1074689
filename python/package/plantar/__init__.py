"""Pressure recordings of feet: regional loads, contact ellipses and tissue parameters.

The computations are those of Plantar's insoles and of the command line ``plantar``. Names of columns end with their units.
``plantar.cohort`` evaluates a whole study; it is a module of its own, because it needs Dask. The documentation calls the source
of the tissue model "the paper": DeBerardinis, Dufek, Trabia, J. Biomech. 92, 2019, 137-145.
"""

import os

from plantar._core import after_fork as _after_fork
from plantar._core import version as __version__
from plantar.fitting import Fit, fit, fit_steps, repeat
from plantar.insole import Event, Insole
from plantar.options import Options
from plantar.recording import REGIONS, Recording, Replay, read, replay
from plantar.walking import Gait, gait

__all__ = [
    "REGIONS",
    "Event",
    "Fit",
    "Gait",
    "Insole",
    "Options",
    "Recording",
    "Replay",
    "__version__",
    "fit",
    "fit_steps",
    "gait",
    "read",
    "repeat",
    "replay",
]

# Windows has no fork.
if hasattr(os, "register_at_fork"):
    os.register_at_fork(after_in_child=_after_fork)
