"""The options of an evaluation."""

import os
from dataclasses import dataclass
from typing import Literal

from plantar.paths import expanded


class AssumedSize(int):
    """The default of the shoe size. Its type shows that the user did not state the size."""


@dataclass(frozen=True, kw_only=True)
class Options:
    """The options of an evaluation. Names and meanings are those of the options of the command line, but those of contact rule
    and stance rule end with their units: ``--contact-on`` is named ``contact_on_kpa``, and ``--strike`` ``strike_n``.
    ``filter``, ``method``, ``bounds``, ``tissue`` and ``compression`` are options of fits, and a replay refuses them.

    ``size``: European shoe size, a whole number from 20 to 52, to which the typical tissue thickness is scaled;
        default: 42, and ``fit`` warns that it is assumed.
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
    ``thresholds``: Thresholds of heel strike and toe off: proportional to the peaks of the wearer's steps (``adaptive``), or
        fixed (``absolute``).
    ``strike_n``: Heel strike is the frame in which the total force reaches this value; default: 35 N. If thresholds are adaptive,
        the value applies to steps with a peak of 700 N.
    ``release_n``: Toe off is the frame in which the total force falls below this value; default: 70 N. If thresholds are
        adaptive, the value applies to steps with a peak of 700 N.
    ``min_stance_ms``: A contact that is shorter than this time is not a step; default: 90 ms.
    ``min_swing_ms``: A gap that is shorter than this time does not end a stance; default: 50 ms.
    ``max_stance_ms``: A contact that is longer than this time is not a step; default: 2500 ms.
    ``zero``: The zero file written by ``plantar zero``. In a study, ``participant.toml`` names the file of each participant
        instead, and ``plantar.cohort`` refuses this option.
    """

    size: int = AssumedSize(42)
    filter: Literal["direct", "live", "smoothed"] | None = None
    method: Literal["projection", "paper"] = "projection"
    bounds: Literal["free", "paper"] = "free"
    tissue: str | os.PathLike[str] | None = None
    compression: float | None = None
    contact_on_kpa: float | None = None
    contact_off_kpa: float | None = None
    contact_full_kpa: float | None = None
    thresholds: Literal["adaptive", "absolute"] = "adaptive"
    strike_n: float | None = None
    release_n: float | None = None
    min_stance_ms: int | None = None
    min_swing_ms: int | None = None
    max_stance_ms: int | None = None
    zero: str | os.PathLike[str] | None = None

    def __post_init__(self) -> None:
        for name in ("tissue", "zero"):
            path = getattr(self, name)
            if path is not None:
                # The class is frozen.
                object.__setattr__(self, name, expanded(path))
