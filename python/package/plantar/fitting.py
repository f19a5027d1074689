"""The identification of tissue parameters."""

from __future__ import annotations

import dataclasses
import hashlib
import json
import os
import pathlib
import warnings
from collections.abc import Iterable, Mapping, Sequence
from functools import cached_property
from typing import TYPE_CHECKING, Any

import pandas as pd

from plantar import _core
from plantar.options import AssumedSize, Options
from plantar.paths import Path, expanded
from plantar.recording import Recording, Recordings, all_of, by_region

if TYPE_CHECKING:
    import pyarrow
    from matplotlib.figure import Figure


def _check_distinct(recordings: Iterable[Recording], known: dict[bytes, str]) -> None:
    """Raises a ``ValueError`` if a recording has the same pressures as another one, or as one of those in ``known``, the paths
    of previous recordings by checksum. Adds the recordings to ``known``."""
    for recording in recordings:
        checksum = hashlib.sha256(recording.pressure_kpa.data).digest()
        if checksum in known:
            raise ValueError(f"{recording.path} has the same pressures as {known[checksum]}: give each recording once")
        known[checksum] = recording.path


def _warn(notes: Iterable[str]) -> None:
    """Issues each note as a warning at the place where the user called the function of the package."""
    for note in notes:
        warnings.warn(note, stacklevel=3)


QUANTITIES = (
    "force_at_70_percent_area_n",
    "area_at_25_percent_force_mm2",
    "area_at_50_percent_force_mm2",
    "area_at_75_percent_force_mm2",
    "area_at_10_n_mm2",
    "area_at_50_n_mm2",
    "area_at_100_n_mm2",
    "area_at_200_n_mm2",
    "secant_stiffness_n_mm",
    "tangent_stiffness_n_mm",
    "secant_modulus_kpa",
    "tangent_modulus_kpa",
    "viscous_modulus_kpa_s",
    "loading_energy_mj",
    "dissipated_energy_mj",
)
"""The quantities that repeat, which docs/identification.md describes, as in the results of a fit and in the table of a cohort."""


def _notes_on_sensors(recordings: Sequence[Recording], values: str, verb: str) -> list[str]:
    """A note if recordings are of different sensors, or have cells of different sizes. ``values`` are the values that the
    function compares or fits, and ``verb`` is what it does."""
    note = _core.note_unless_same_sensor([recording._core for recording in recordings], values, verb)
    return [] if note is None else [note]


def _notes_on_fit(results: dict[str, Any], options: Options) -> list[str]:
    """The notes that ``plantar fit`` prints on a fit as a whole."""
    name, notes = results["participant"], []
    regions = results["regions"].values()
    has_typical_thickness = any(result["fitted"] and result["pinned"]["d0_by"] == "shoe_size" for result in regions)
    if has_typical_thickness and isinstance(options.size, AssumedSize):
        notes.append(
            f"{name}: size {options.size} assumed for the typical thickness of the tissue: state the size of the shoe "
            "with Options(size=...)"
        )
    sides = [results["recordings"][step["recording"]]["side"] for step in results["steps"]]
    if len(set(sides)) == 2:
        left, right = (_counted(sides.count(side), "step") for side in ("left", "right"))
        notes.append(
            f"{name}: the parameters are those of both feet together: {left} of the left foot and {right} of the right "
            "foot; fit each foot separately for its own parameters"
        )
    if left_out := results["left_out"]:
        contacts = [
            f"{results['recordings'][contact['recording']]['name']} at {contact['at_s']:.2f} s, {contact['why']}"
            for contact in left_out
        ]
        # A long recording can have many of them: one warning names the first ones, and `results` has all.
        more = "" if len(contacts) <= _NAMED_CONTACTS else "; results['left_out'] has all of them"
        count = _counted(len(contacts), "contact")
        notes.append(f"{name}: {count} left out: {'; '.join(contacts[:_NAMED_CONTACTS])}{more}")
    return notes


_NAMED_CONTACTS = 3
"""Largest number of contacts that the warning about contacts that were left out names."""


def _counted(count: int, noun: str) -> str:
    """A number with its noun, such as ``2 steps``."""
    return f"{count} {noun}{'' if count == 1 else 's'}"


def fit(recordings: Recordings, *, participant: str | None = None, options: Options = Options()) -> Fit:
    """Identifies the tissue parameters of one person from recordings of walking, like ``plantar fit``.

    Several trials and both feet may be given. ``participant`` is the name of the person; the default is the name of the first
    file without its extension and, for both feet, without the name of the foot at its end. Raises a ``ValueError`` if a
    recording is given twice.

    If the result of a region is incomplete, for example because only one step could be used, a ``UserWarning`` for each defect
    names the region and the remedy. ``Fit.table`` has the defects, too, and the reasons of regions that were not fitted. If no
    region was fitted, a ``UserWarning`` states the reasons. Further warnings, as ``plantar fit`` prints them, concern recordings
    of both feet and of different sensors, contacts that were left out, and a typical thickness of an assumed shoe size.
    """
    given = all_of(recordings)
    if not given:
        raise ValueError("no recording: give one or more recordings of a person")
    # The cross-validation predicts a step from the other steps. With a copy of the step among them, the predicted error would be
    # too small.
    _check_distinct(given, {})
    core, notes = _core.identify([recording._core for recording in given], participant, options)
    fitted = Fit(core)
    name = fitted.results["participant"]
    # The wording is that of the command line, which ends with exit status 3 if a result is incomplete. Python shows equal
    # warnings of the same line only once. The name of the person makes them different, so that a loop over people shows all.
    defects = [
        f"{name}, {region}: INCOMPLETE: {defect}"
        for region, result in fitted.results["regions"].items()
        for defect in result.get("defects", [])
        # A measurement that is out of range is a defect of a fitted region, and has a note even if the region was not fitted.
        if not any(note.endswith(f"{region}: {defect}") for note in notes)
    ]
    regions = fitted.results["regions"].values()
    if not any(result["fitted"] for result in regions):
        reasons = dict.fromkeys(result["reason"] for result in regions)
        defects.append(f"{name}: no region could be fitted: {' | '.join(reasons)}")
    _warn([*notes, *_notes_on_sensors(given, "steps", "fit"), *_notes_on_fit(fitted.results, options), *defects])
    return fitted


def fit_steps(recording: Recording | Path, *, options: Options = Options()) -> pyarrow.Table:
    """Fits each region of each step of a recording separately, like ``plantar cohort``.

    The table has one row for each region of each step. The function needs no other recording and has no state, so that many
    recordings can be evaluated in parallel, for example by Dask or Spark. A ``UserWarning`` with the path of the recording names
    each defect of a fitted region, which the column ``defects`` has, too. A region that was not fitted is in the column
    ``reason``.
    """
    import pyarrow

    given = all_of(recording)
    if len(given) != 1:
        raise ValueError(f"{len(given)} recordings, but fit_steps fits one recording: call it for each of them")
    person = _core.Person(options)
    _warn(person.notes)
    table = pyarrow.Table.from_batches([person.rows(given[0]._core)])
    # Python shows equal warnings of the same line only once. The recordings of several people can have equal file names, so the
    # path makes the warnings different.
    _warn([f"incomplete: {given[0].path}, {region}: {defect}" for _, region, defect in defects_of(table)])
    return table


def defects_of(rows: pyarrow.Table) -> list[tuple[str, str, str]]:
    """The different defects in the rows of steps, each after the names of its recording and region."""
    columns = (rows.column(name).to_pylist() for name in ("recording", "region", "defects"))
    found = (
        (recording, region, defect)
        for recording, region, defects in zip(*columns, strict=True)
        for defect in (defects or "").split(" | ")
        if defect
    )
    return list(dict.fromkeys(found))


def repeat(
    people: Recordings | Mapping[str, Recordings], *, options: Options | Mapping[str, Options] = Options()
) -> pd.DataFrame:
    """Repeatability between trials, like ``plantar repeat``: ICC(2,1), standard error of measurement and minimal detectable
    change, both in the unit of the variable.

    ``people`` has the recordings of each person by the person's name. It can also be the recordings of one person; the
    column of the ICC is then empty. If people have different numbers of trials of a foot, the first trials of each, in the order
    given, are compared. The table has one row for each foot, variable and region, an ordered category from heel to toes.

    ``options`` are the options of everyone, or the options of each person by the person's name. People can differ in ``size``,
    ``tissue`` and ``zero``, the values of ``participant.toml``.

    Raises a ``ValueError`` if a recording is given twice, also for different people, and if there are too few trials to compare:
    by name, at least two people need two trials of the same foot. A ``UserWarning`` names each person who is left out of the
    comparison of a foot, each person with trials of different sensors, and each fitted region of a recording with an incomplete
    result. A region that was not fitted has no values in this recording, and no warning.
    """
    recordings_of = people if isinstance(people, Mapping) else {"the person": people}
    options_of = options if isinstance(options, Mapping) else dict.fromkeys(recordings_of, options)
    if set(options_of) != set(recordings_of):
        names, expected = ", ".join(options_of), ", ".join(recordings_of)
        raise ValueError(f"options of {names}, but recordings of {expected}: give the options of every person by name")
    shared = {dataclasses.replace(each, size=Options.size, tissue=None, zero=None) for each in options_of.values()}
    if len(shared) > 1:
        raise ValueError("people may differ only in size, tissue and zero: values by other options are not comparable")
    # People with equal options share an object, so that a note on their options is issued once.
    persons = {each: _core.Person(each) for each in options_of.values()}
    for person in persons.values():
        _warn(person.notes)
    # A copy would be a trial without any error of measurement.
    known: dict[bytes, str] = {}
    trials_of: list[tuple[str, list[_core.Trial]]] = []
    for name, of_person in recordings_of.items():
        given = all_of(of_person)
        _check_distinct(given, known)
        for side in ("left", "right"):
            of_side = [recording for recording in given if recording.side == side]
            _warn(_notes_on_sensors(of_side, "trials", "compare"))
        trials_of.append((name, [persons[options_of[name]].trial(recording._core) for recording in given]))
    least_people = 2 if isinstance(people, Mapping) else 1
    try:
        table, left_out = _core.repeatability(trials_of, least_people)
    except ValueError as error:
        if least_people == 1 or not any(map(_is_comparable, trials_of)):
            raise
        # The recordings of one person are sufficient: a list of them is compared without other people.
        raise ValueError(f"{error}, or give the recordings of one person as a list, without the name") from error
    defects = [f"incomplete: {name}, {defect}" for name, trials in trials_of for trial in trials for defect in trial.defects]
    _warn([f"left out: {reason}" for reason in left_out] + defects)
    frame: pd.DataFrame = table.to_pandas()
    frame["region"] = by_region(frame["region"])
    return frame.set_index(["side", "variable", "region"])


def _is_comparable(person: tuple[str, list[_core.Trial]]) -> bool:
    """True if a person has enough trials of a foot to compare them without other people."""
    try:
        _core.repeatability([person], 1)
    except ValueError:
        return False
    return True


class Fit:
    """The identified tissue parameters of one person."""

    def __init__(self, core: _core.Fitted) -> None:
        self._core = core

    def __repr__(self) -> str:
        regions = self.results["regions"].values()
        fitted = sum(result["fitted"] for result in regions)
        incomplete = sum(bool(result.get("defects")) for result in regions)
        steps = _counted(len(self.results["steps"]), "step")
        recordings = _counted(len(self.results["recordings"]), "recording")
        defects = f", {incomplete} of them with incomplete results" if incomplete else ""
        return (
            f"<Fit of {self.results['participant']}: {steps} of {recordings}, {self.results['filter']} filter, "
            f"{fitted} of {len(regions)} regions fitted{defects}>"
        )

    @cached_property
    def results(self) -> dict[str, Any]:
        """All results, as in the JSON file of ``plantar fit`` without ``--report``."""
        results: dict[str, Any] = json.loads(self._core.json())
        return results

    def table(self) -> pd.DataFrame:
        """One row for each region: the paper's eight parameters, the identified parameters with their 95 % intervals, the
        errors in percent of the peak force, and for a region that was not fitted the reason.

        ``stiffness_identifiable`` is false if the steps do not determine the parameter: its value is then the usual one of other
        people, or has no meaning. ``stiffness_at_bound`` is true if it is at a bound of the search. The other identified
        parameters have such columns, too, with the names ``ab``, ``damping``, ``n`` and ``m``. They are ``None`` without an
        interval. ``results`` has both intervals of each parameter (``uncertainty``).

        The quantities that repeat, such as ``force_at_70_percent_area_n`` and ``secant_modulus_kpa``, have the names of the table
        of a cohort (docs/cohort.md), and 95 % intervals, too. They are NaN if the region does not reach the force or strain of
        the definition. A quantity with an interval that is wider than its value is not determined (``results`` has
        ``is_determined``).

        ``defects`` has the defects because of which the result of a fitted region is incomplete, separated by `` | ``, and
        ``None`` if there is none. ``warnings`` has remarks on a result in the same form, for example that parameters compensate
        each other. ``results`` has both as lists."""
        rows = []
        for region, result in self.results["regions"].items():
            row: dict[str, Any] = {"region": region, "fitted": result["fitted"], "reason": result.get("reason")}
            # As text, so that the column can be written to CSV files. The defects are sentences that contain semicolons.
            row["defects"] = " | ".join(result.get("defects", [])) or None
            row["warnings"] = " | ".join(result.get("warnings", [])) or None
            if result["fitted"]:
                row |= {"steps": len(result["steps"]), "area_max_mm2": result["area_max_mm2"], **result["ellipsoid"]}
                intervals = (result["uncertainty"] or {}).get("intervals_95", {})
                for name, value in result["identified"].items():
                    name, factor = ("ab_mm2", 1e6) if name == "ab_m2" else (name, 1.0)
                    interval = intervals.get("ab_m2" if name == "ab_mm2" else name, {})
                    ends = _widest(interval.get("jacobian"), interval.get("bootstrap"))
                    row[name] = value * factor
                    row[f"{name}_low"], row[f"{name}_high"] = (end * factor for end in ends)
                    # The table of a cohort has the name with `at_bound`, too.
                    flag = name.partition("_")[0]
                    row[f"{flag}_identifiable"] = interval.get("is_identifiable")
                    row[f"{flag}_at_bound"] = interval.get("at_bound")
                for name in QUANTITIES:
                    # A region that does not reach the force or strain of the definition does not have the quantity.
                    quantity = result["quantities"].get(name, {})
                    row[name] = quantity.get("value", float("nan"))
                    row[f"{name}_low"], row[f"{name}_high"] = _widest(quantity.get("interval_95"))
                row |= {f"nrmse_{name}_percent": value for name, value in result["nrmse_percent"].items()}
                row["verdict"] = result["verdict"]
            rows.append(row)
        return pd.DataFrame(rows).set_index("region")

    @cached_property
    def curves(self) -> pd.DataFrame:
        """Area, mm2, measured force and model force, N, of each fitted region in each step, from the start of the region's
        contact. ``region`` is an ordered category from heel to toes."""
        table: pd.DataFrame = self._core.curves().to_pandas()
        table["region"] = by_region(table["region"])
        return table

    def write(self, path: Path) -> None:
        """Writes the parameter file, for ``replay(params=...)``, the command line and ``Insole.push``."""
        pathlib.Path(expanded(path)).write_text(self._core.toml(), encoding="utf-8")

    def report(self, path: Path) -> None:
        """Writes the report of ``plantar fit`` as an HTML file, but does not repeat the fit with other choices of the method."""
        pathlib.Path(expanded(path)).write_text(self._core.html(), encoding="utf-8")

    def plot(self) -> Figure:
        """Draws the measured and the model force of each region over all steps, with the parameters and their errors."""
        from plantar import plots

        return plots.fit(self)


def _widest(*intervals: list[float | None] | None) -> tuple[float, float]:
    """The widest of the intervals that exist; two NaN if there is none. An end that is ``None`` in JSON is infinite."""
    existing = [
        (float("-inf") if low is None else low, float("inf") if high is None else high)
        for low, high in filter(None, intervals)
    ]
    return max(existing, key=lambda ends: ends[1] - ends[0], default=(float("nan"), float("nan")))
