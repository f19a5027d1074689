"""The options of an evaluation."""

import os
from dataclasses import dataclass
from typing import Literal


@dataclass(frozen=True, kw_only=True)
class Options:
    """The options of an evaluation. Names and meanings are those of the options of the command line."""

    size: int = 42
    """European shoe size, 35 to 46, to which the typical tissue thickness is scaled."""
    filter: Literal["direct", "live", "smoothed"] | None = None
    """The filter of the contact area; the default is direct, or smoothed with the method of the paper."""
    method: Literal["projection", "paper"] = "projection"
    """The search: five parameters with a prior, or the eight parameters of the paper from ten random starts."""
    bounds: Literal["free", "paper"] = "free"
    """The bounds of the exponents."""
    tissue: str | os.PathLike[str] | None = None
    """The file of tissue measurements."""
    compression: float | None = None
    """Assumed largest compression of the tissue, as a fraction of its thickness."""
    contact_on_kpa: float | None = None
    """A cell comes into contact at this pressure; the default is 10 kPa."""
    contact_off_kpa: float | None = None
    """A cell loses contact below this pressure; the default is 3/4 of ``contact_on_kpa``."""
    contact_full_kpa: float | None = None
    """A cell counts as a whole from this pressure on; 0 to count whole cells only, and 150 kPa by default."""
    zero: str | os.PathLike[str] | None = None
    """The baseline file from ``plantar zero``. In a study, ``participant.toml`` names the file of each participant instead."""
