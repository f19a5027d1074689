"""The measures of gait from the recordings of both feet."""

from __future__ import annotations

import json
import warnings
from functools import cached_property
from typing import Any

import pandas as pd

from plantar import _core
from plantar.options import Options
from plantar.recording import Recordings, all_of


def gait(recordings: Recordings, *, options: Options = Options()) -> Gait:
    """The measures of gait, like ``plantar gait``: stride, step, stance and swing time, double and single support, flight,
    cadence and symmetry. docs/measures.md has the definitions.

    ``recordings`` are those of both feet in the same walk, with times on one clock, or that of one foot. Without the other foot,
    or with recordings of the cells of insoles, which have no common clock, the measures that need both feet are NaN. Of the
    options, those of the stance rule and ``zero`` have an effect; others are refused, but ``size`` is ignored.

    Raises a ``ValueError`` if two recordings are of the same foot or have different rates, or if there is no step. A
    ``UserWarning`` states that the recordings do not seem to be of the same walk, names contacts that are no steps, with the
    option that admits them, and a foot without a step or one that was not unloaded between its steps.
    """
    given = all_of(recordings)
    if not given:
        raise ValueError("no recording: give the recording of a walk, or those of both feet")
    core, notes = _core.gait([recording._core for recording in given], options)
    for note in notes:
        warnings.warn(note, stacklevel=2)
    return Gait(core)


class Gait:
    """The measures of a walk."""

    def __init__(self, core: _core.Gait) -> None:
        self._core = core

    def __repr__(self) -> str:
        strides = self.results["strides"]
        return f"<Gait of {strides['left']} strides of the left foot and {strides['right']} of the right foot>"

    @cached_property
    def results(self) -> dict[str, Any]:
        """All results, as in the JSON file of ``plantar gait``, without the speed."""
        results: dict[str, Any] = json.loads(self._core.json())
        return results

    def table(self) -> pd.DataFrame:
        """One row for each measure that exists, indexed by ``measure``, a name with its unit, and ``of``: ``left`` and ``right``,
        ``symmetry_percent`` (0 for equal feet, positive if the left value is larger), and ``both`` for the cadence. The columns are
        the mean, the standard deviation, the 95 % confidence interval of the mean, which takes into account that successive
        strides are correlated, and the number of values."""
        estimates = [(measure["key"], of, measure[of]) for measure in self.results["measures"] for of in _OF]
        estimates.append(("cadence_per_min", "both", self.results["cadence_per_min"]))
        rows = [{"measure": name, "of": of, **estimate} for name, of, estimate in estimates if estimate is not None]
        # Without any interval, pandas would not know that its ends are numbers.
        numbers = dict.fromkeys(["mean", "sd", "low", "high"], float)
        table = pd.DataFrame(rows, columns=["measure", "of", *numbers, "count"])
        return table.astype(numbers).set_index(["measure", "of"])

    @cached_property
    def strides(self) -> pd.DataFrame:
        """One row for each stride in use, indexed by ``side`` and ``start_s``, the heel strike on the time axis of the recordings.
        ``other_start_s`` is the heel strike of the other foot within the stride, and ``is_consecutive`` is true if the stride
        before it ends at its beginning. The other columns are the measures."""
        strides: pd.DataFrame = self._core.strides().to_pandas()
        return strides.set_index(["side", "start_s"])

    def speed_m_s(self, *, stride_length_m: float | None = None, distance_m: float | None = None) -> float:
        """The walking speed, m/s, from one of two lengths: the mean length of a stride, 0.1 to 6 m, or the distance from the
        first to the last heel strike of the walk. NaN without a stride, or if only one of two recorded feet takes steps; and, for
        a distance, if there is a pause or a missing step, if one foot is missing, or if the feet have no common clock."""
        if (stride_length_m is None) == (distance_m is None):
            raise TypeError("give either stride_length_m or distance_m")
        length_m = stride_length_m if stride_length_m is not None else distance_m
        assert length_m is not None
        if stride_length_m is not None and not 0.1 <= stride_length_m <= 6:
            raise ValueError(f"stride_length_m = {stride_length_m}: expected the length of a stride in metres, 0.1 to 6")
        if not 0 < length_m < float("inf"):
            raise ValueError(f"distance_m = {distance_m}: expected a length in metres, above 0")
        of = self._core.speed_of_walk_m_s if stride_length_m is None else self._core.speed_of_strides_m_s
        speed_m_s = of(length_m)
        return float("nan") if speed_m_s is None else speed_m_s


_OF = ("left", "right", "symmetry_percent")
"""The keys of the estimates of a measure in the results."""
