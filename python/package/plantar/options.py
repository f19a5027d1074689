"""The options of an evaluation."""

import os
from dataclasses import dataclass
from typing import Literal


@dataclass(frozen=True, kw_only=True)
class Options:
    """The options of an evaluation. Names and meanings are those of the options of the command line, but ``--contact-on``,
    ``--contact-off`` and ``--contact-full`` are named ``contact_on_kpa``, ``contact_off_kpa`` and ``contact_full_kpa``.
    ``filter``, ``method``, ``bounds``, ``tissue`` and ``compression`` are options of fits, and a replay refuses them.

    ``size``: European shoe size, a whole number from 20 to 52, to which the typical tissue thickness is scaled.
    ``filter``: The filter of the contact area: that of the step records of an insole (``direct``), that of its live stream
        (``live``) or, for comparison, the smoothing of the paper (``smoothed``). Parameters are valid only for the filter of
        their fit. Default: ``direct``, or ``smoothed`` with the method of the paper.
    ``method``: The search: five parameters, with the distribution among people as prior (``projection``) or, for comparison, the
        paper's search for eight parameters from ten random starts, which fits the smoothed force (``paper``).
    ``bounds``: The bounds of the exponents. ``free``: n from -0.95 on, with the prior; ``paper``: n at least 0, least squares
        without a prior. Not used by the method of the paper.
    ``tissue``: The file of tissue measurements.
    ``compression``: Assumed largest compression of the tissue, as a fraction of its thickness; default: 0.457.
    ``contact_on_kpa``: A cell comes into contact at this pressure; default: the value in the parameter file, or 10 kPa.
    ``contact_off_kpa``: A cell loses contact below this pressure; default: the same fraction of ``contact_on_kpa`` as in the
        parameter file, or 3/4.
    ``contact_full_kpa``: A cell in contact counts with the fraction sqrt(p / this pressure) of its area, at most 1, where p is
        its pressure; 0: always with its whole area, as in the paper; default: the value in the parameter file, or 150 kPa.
    ``zero``: The zero file written by ``plantar zero``. In a study, ``participant.toml`` names the file of each participant
        instead, and ``plantar.cohort`` refuses this option.
    """

    size: int = 42
    filter: Literal["direct", "live", "smoothed"] | None = None
    method: Literal["projection", "paper"] = "projection"
    bounds: Literal["free", "paper"] = "free"
    tissue: str | os.PathLike[str] | None = None
    compression: float | None = None
    contact_on_kpa: float | None = None
    contact_off_kpa: float | None = None
    contact_full_kpa: float | None = None
    zero: str | os.PathLike[str] | None = None
