"""Recordings, and their replay with the insole's own code."""

from __future__ import annotations

import math
import os
import pathlib
import warnings
from collections.abc import Iterable
from functools import cached_property
from typing import TYPE_CHECKING, Any, Literal, TypeAlias

import numpy as np
import numpy.typing as npt
import pandas as pd
import pyarrow as pa

from plantar import _core
from plantar.options import Options
from plantar.paths import Path, expanded

if TYPE_CHECKING:
    import xarray
    from matplotlib.figure import Figure

REGIONS = (
    "heel",
    "posterior_midfoot",
    "anterior_midfoot",
    "metatarsals_12",
    "metatarsals_35",
    "hallux",
    "toe_2",
    "toes_35",
)
"""The names of the regions, from heel to toes."""


def by_region(names: pd.Series) -> pd.Categorical:
    """The names of regions as an ordered category: pandas then sorts them from heel to toes instead of by their names."""
    return pd.Categorical(names, REGIONS, ordered=True)


def read(path: Path) -> Recording:
    """Reads a recording: a Parquet file, or a folder with the parts of one.

    Raises an ``OSError`` if the file cannot be read, and a ``ValueError`` that names the place and the remedy if it is not a
    recording. A ``UserWarning`` states that the largest force or the cells cannot be those of a foot in walking, because a value
    may be in another unit, or that the range of the sensor seems to limit the pressures.
    """
    recording = opened(path)
    for note in notes_on_units(recording):
        warnings.warn(note, stacklevel=2)
    return recording


def opened(path: Path) -> Recording:
    """Reads a recording without warnings."""
    path = expanded(path)
    try:
        return Recording(_core.Recording.read(path))
    except ValueError as error:
        if (remedy := _remedy_for_live_stream(pathlib.Path(path))) is not None:
            raise ValueError(f"{os.fspath(path)}: {remedy}") from error
        raise


def _remedy_for_live_stream(path: pathlib.Path) -> str | None:
    """The remedy if the path is not a recording of all cells, but a recorded live stream, which the command line fits."""
    command = f"`plantar fit {path}` fits it"
    if (path / "live").is_dir() or (path / "steps").is_dir():
        cells = path / "cells"
        if cells.is_dir():
            remedy = f"Python reads the recordings of all cells, which are the folders in {cells}"
        else:
            remedy = "Python reads recordings of all cells only, which `plantar record --cells` writes, too"
        return f"a folder of `plantar record` with live frames and steps: {command}; {remedy}"
    if path.suffix == ".plantar" and path.is_file():
        return f"a recorded live stream: {command}; Python reads recordings of all cells only"
    return None


def notes_on_units(recording: Recording) -> list[str]:
    """Notes on values that seem to be in another unit, and on exchanged axes."""
    return [f"{recording.path}: {warning}" for warning in recording._core.unit_warnings()]


def all_of(recordings: Recordings) -> list[Recording]:
    """All recordings, read from their files if necessary, with the warnings of ``read``. To be called by a function that the user
    calls: the warnings are issued at the place of this call."""
    # A path as `bytes` is iterable, too, but not a list of recordings.
    is_single = isinstance(recordings, (Recording, str, bytes, os.PathLike))
    several: Any = [recordings] if is_single else recordings
    result = []
    for recording in several:
        if not isinstance(recording, Recording):
            recording = opened(recording)
            for note in notes_on_units(recording):
                warnings.warn(note, stacklevel=3)
        result.append(recording)
    return result


def replay(
    recording: Recording | Path,
    *,
    params: Path | None = None,
    precision: Literal["f32", "f64"] = "f32",
    options: Options = Options(),
) -> Replay:
    """The steps of a recording as an insole computes them, like ``plantar replay``. See ``Recording.replay``."""
    if not isinstance(recording, Recording):
        recording = opened(recording)
        for note in notes_on_units(recording):
            warnings.warn(note, stacklevel=2)
    return Replay(recording, params, precision, options)


class Recording:
    """The pressure under one foot over time. ``t_s`` and ``pressure_kpa`` share the memory of the recording, read-only."""

    def __init__(self, core: _core.Recording) -> None:
        self._core = core

    @staticmethod
    def from_numpy(
        pressure_kpa: npt.ArrayLike,
        cells: pd.DataFrame,
        *,
        side: Literal["left", "right"],
        rate_hz: float,
        name: str,
        sensor: str,
        t_s: npt.ArrayLike | None = None,
        source: str | None = None,
    ) -> Recording:
        """A recording of pressures from another program.

        ``pressure_kpa`` has one row for each frame and one column for each cell, from 0 to 50,000 kPa, and is copied as 32-bit
        floating-point numbers. ``cells`` has one row for each cell with the columns ``x_mm``, ``y_mm`` and ``area_mm2`` as in
        ``Recording.cells``, and optionally ``region``; without this column, regions are assigned by the template, as in
        ``plantar import``. ``name`` is that of the recording in messages and, up to its last point, the default of the person's
        name in a fit. ``sensor`` is the name of the layout: recordings of one sensor have the same. ``t_s`` has the time of each
        frame, at ``rate_hz``; the default starts at 0. ``source`` states the origin of the measurement and its processing, in
        sentences; the default is the name.

        Raises a ``ValueError`` that names the frame or the cell if a value is out of range. It has the warnings of ``read``.
        """
        pressures = np.ascontiguousarray(pressure_kpa, dtype=np.float32)
        if pressures.ndim != 2 or pressures.shape[1] != len(cells):
            raise ValueError(
                f"{name}: pressure_kpa has the shape {pressures.shape}: expected one row for each frame, and one column for each "
                f"of the {len(cells)} cells"
            )
        if missing := [column for column in ("x_mm", "y_mm", "area_mm2") if column not in cells]:
            raise ValueError(f"{name}: cells has no column {missing[0]}")
        times = np.arange(len(pressures)) / rate_hz if t_s is None else np.asarray(t_s, dtype=np.float64)
        if times.shape != (len(pressures),):
            raise ValueError(f"{name}: t_s has the shape {times.shape}: expected one time for each of {len(pressures)} frames")
        places = cells[["x_mm", "y_mm", "area_mm2"]].astype(float).itertuples(index=False, name=None)
        has_regions = "region" in cells
        if has_regions and cells["region"].isna().any():
            raise ValueError(f"{name}: cells: a cell has no region: give each cell a region, or leave out the column")
        core = _core.Recording.from_arrays(
            pa.array(times),
            pa.array(pressures.ravel()),
            list(places),
            list(cells["region"].astype(str)) if has_regions else None,
            side,
            rate_hz,
            name,
            sensor,
            f"{name}." if source is None else source,
        )
        recording = Recording(core)
        for note in notes_on_units(recording):
            warnings.warn(note, stacklevel=2)
        return recording

    def __repr__(self) -> str:
        frames, cells = self.pressure_kpa.shape
        return f"<Recording {self.path}: {self.side} foot, {frames} frames of {cells} cells at {self.rate_hz:g} Hz>"

    def part(self, from_s: float | None = None, to_s: float | None = None) -> Recording:
        """The frames from ``from_s`` to ``to_s``, both included, s, as a recording with the same times. Contacts that a limit
        cuts off are no steps. Raises a ``ValueError`` if there is no such frame."""
        return Recording(self._core.part(from_s, to_s))

    def write(self, path: Path) -> None:
        """Writes the recording to a Parquet file, for ``read`` and the command line."""
        self._core.write(expanded(path))

    @property
    def path(self) -> str:
        """The file, or the folder with the parts of the recording."""
        return self._core.path

    @property
    def side(self) -> Literal["left", "right"]:
        """The foot: ``left`` or ``right``."""
        return self._core.side

    @property
    def rate_hz(self) -> float:
        """Frames per second."""
        return self._core.rate_hz

    @property
    def source(self) -> str:
        """Provenance: the origin of the measurement and its processing, in sentences."""
        return self._core.source

    @cached_property
    def t_s(self) -> npt.NDArray[np.float64]:
        """Time of each frame, s."""
        times: npt.NDArray[np.float64] = self._core.t_s().to_numpy()
        return times

    @cached_property
    def pressure_kpa(self) -> npt.NDArray[np.float32]:
        """Pressure, kPa: one row for each frame, one column for each cell."""
        values: npt.NDArray[np.float32] = self._core.pressure_kpa().to_numpy()
        return values.reshape(len(self.t_s), -1)

    @property
    def cells(self) -> pd.DataFrame:
        """The cells in foot coordinates: ``x_mm`` to the lateral side, ``y_mm`` from heel to toes, ``area_mm2``, and ``region``,
        an ordered category from heel to toes. Each use returns a table of its own: a change of it does not change forces."""
        cells: pd.DataFrame = self._core.cells().to_pandas()
        cells["region"] = by_region(cells["region"])
        return cells.set_index("cell")

    @cached_property
    def _areas_mm2(self) -> npt.NDArray[np.float64]:
        """The areas of the cells, mm2."""
        return self.cells["area_mm2"].to_numpy(float)

    @property
    def force_n(self) -> npt.NDArray[np.float64]:
        """Force on all cells in each frame, N."""
        # 1 kPa on 1 mm2 is 1 mN.
        force_n: npt.NDArray[np.float64] = self.pressure_kpa @ self._areas_mm2 * 1e-3
        return force_n

    def to_pandas(self) -> pd.DataFrame:
        """A table of the pressures with the columns of the file, ``c0_kpa``, ``c1_kpa``, ..., indexed by ``t_s``."""
        names = [f"c{cell}_kpa" for cell in self.cells.index]
        return pd.DataFrame(self.pressure_kpa, index=pd.Index(self.t_s, name="t_s"), columns=names, copy=False)

    def to_xarray(self) -> xarray.Dataset:
        """A data set with ``pressure_kpa`` along ``t_s`` and ``cell``, and with ``x_mm``, ``y_mm``, ``area_mm2`` and
        ``region`` as coordinates along ``cell``."""
        import xarray

        coordinates: dict[str, Any] = {str(name): ("cell", column.to_numpy()) for name, column in self.cells.items()}
        return xarray.Dataset(
            {"pressure_kpa": (("t_s", "cell"), self.pressure_kpa)},
            coords={"t_s": self.t_s, "cell": self.cells.index.to_numpy(), **coordinates},
            attrs={"side": self.side, "rate_hz": self.rate_hz, "source": self.source},
        )

    def replay(
        self,
        *,
        params: Path | None = None,
        precision: Literal["f32", "f64"] = "f32",
        options: Options = Options(),
    ) -> Replay:
        """The steps as an insole computes them, with the same code.

        ``params`` is a parameter file. Without one, typical parameters of ``options.size`` are used, and a warning states that
        they are not personal. Warnings also name regions to which typical parameters do not apply, contacts that are no steps,
        values at the end of their range, sensor faults and masked cells, or state that there is no step. ``precision`` is
        ``f32``, that of the insole, or ``f64``. Raises a ``ValueError`` if an option that has no effect on a replay, such as
        ``filter``, differs from its default.
        """
        return Replay(self, params, precision, options)

    def plot(self) -> Figure:
        """Draws the peak pressure of each cell over the whole recording, with colours from 0 kPa on. The squares have the areas
        of the cells and are around their centres, but do not have their shapes."""
        from plantar import plots

        return plots.foot(self, self.pressure_kpa.max(axis=0), f"Peak pressure, {self.side} foot")


Recordings: TypeAlias = Recording | Path | Iterable[Recording | Path]
"""One recording or several of them, each a recording or the path of one."""


class Replay:
    """The steps of a recording as an insole computes them."""

    def __init__(
        self, recording: Recording, params: Path | None, precision: Literal["f32", "f64"], options: Options
    ) -> None:
        self.recording = recording
        params = None if params is None else expanded(params)
        self._arguments = (options, params, precision)
        records, bouts, _, notes = _core.replay(recording._core, *self._arguments, False)
        for note in notes:
            # At the place where the user called the function or the method `replay`, which creates this object.
            warnings.warn(note, stacklevel=3)
        steps = self._on_clock_of_recording(records)
        self.steps: pd.DataFrame = steps.set_index(["step", "region"])
        """One row for each region of each step, indexed by ``step`` and ``region``, an ordered category from heel to toes.
        docs/quantities.md describes the columns. ``start_s`` is on the time axis of the recording, as ``frames`` and
        ``fit_steps`` are, and not the time since the first scan. Without a step, the table has all columns and no row."""
        self.bouts: pd.DataFrame = self._on_clock_of_recording(bouts).set_index(["number", "region"])
        """The load outside of steps, such as standing: one row for each region of each load bout, indexed by ``number`` and
        ``region``. Steps and load bouts are numbered together. docs/measures.md describes load bouts. The last one ends with the
        recording."""

    def _on_clock_of_recording(self, records: pa.RecordBatch) -> pd.DataFrame:
        """The table of steps or load bouts, with ``start_s`` on the time axis of the recording. An insole counts time from its
        first scan."""
        table: pd.DataFrame = records.to_pandas()
        table["start_s"] = self.recording.t_s[(table["start_s"] / self._period_s).round().astype(int)]
        table["region"] = by_region(table["region"])
        return table

    def __repr__(self) -> str:
        steps = len(self.steps.index.unique("step"))
        options, params, precision = self._arguments
        of = f"typical parameters of size {options.size}" if params is None else os.fspath(params)
        return (
            f"<Replay of {self.recording.path}: {self.recording.side} foot, {steps} step{'' if steps == 1 else 's'}, "
            f"{of}, {precision}>"
        )

    @cached_property
    def frames(self) -> pd.DataFrame:
        """The live values of every frame, indexed by the ``t_s`` of the recording, s: columns such as ``heel_area_mm2`` and
        ``total_force_n``. A value that does not exist is NaN, such as the centre of pressure of a region without force.
        docs/exporting.md describes forces, areas and axes, and docs/quantities.md the other columns."""
        _, _, frames, _ = _core.replay(self.recording._core, *self._arguments, True)
        assert frames is not None
        names, columns = frames.schema.names, frames.columns
        # All columns in one array. `to_pandas` and `set_index` would need three times the memory, and leave each column in an
        # array of its own: pandas then issues a PerformanceWarning when a column is added, for example by `reset_index`.
        values = np.empty((len(columns) - 1, len(frames)))
        for row, column in zip(values, columns[1:], strict=True):
            row[:] = column.to_numpy()
        return pd.DataFrame(values.T, index=pd.Index(columns[0].to_numpy(), name=names[0]), columns=names[1:], copy=False)

    @cached_property
    def cell_peaks_kpa(self) -> pd.DataFrame:
        """The peak pressure of each cell in each step, kPa: one row for each step, one column for each cell of
        ``recording.cells``. Their mean, ``cell_peaks_kpa.mean()``, is the mean peak pressure picture of the steps.

        These are pressures of the recording. The steps have those above the baseline, from which the zero of the options is
        subtracted, too."""
        first, frames = self._stances()
        pressure_kpa = self.recording.pressure_kpa
        # The frame of toe off is not part of the stance: its force is below the threshold.
        stances = (pressure_kpa[start : start + count] for start, count in zip(first, frames, strict=True))
        peaks = np.array([stance.max(axis=0) for stance in stances], dtype=np.float32)
        cells, steps = self.recording.cells.index, self.steps.index.unique("step")
        return pd.DataFrame(peaks.reshape(-1, len(cells)), index=steps, columns=cells)

    def _stances(self) -> tuple[npt.NDArray[np.int64], npt.NDArray[np.int64]]:
        """The frame of heel strike of each step, and the number of frames from it to that of toe off, which is not included."""
        steps = self.steps.groupby(level="step", sort=False)[["start_s", "duration_s"]].first()
        first: npt.NDArray[np.int64] = self.recording.t_s.searchsorted(steps["start_s"])
        return first, (steps["duration_s"].to_numpy() / self._period_s).round().astype(np.int64)

    def normalised(
        self, quantity: str, points: int = 101, *, region: str | None = None
    ) -> npt.NDArray[np.float64]:
        """A column of ``frames`` over the stance of each step, by linear interpolation. 0 % of stance is the frame of heel
        strike, and 100 % is the last frame before that of toe off, as in the columns ``gait_x_10_mm`` and so on of ``steps``.

        The result has one row for each step, in the order of ``steps``, and ``points`` columns: the form that spm1d expects. With
        a region, ``quantity`` is the name without the prefix, such as ``area_mm2``. The unit is that of the column.

        The centre of pressure exists only while a region has force, and the ellipse only while it has contact, so their curves
        are NaN in the rest of the stance. spm1d needs numbers: select the points at which all curves of all compared groups have
        a value, for each group ``np.isfinite(curves).all(axis=0)``. Raises a ``ValueError`` if there is no such region or
        quantity, or if ``points`` is less than 2.
        """
        if region is not None and region not in REGIONS:
            raise ValueError(f"there is no region {region}: the regions are {', '.join(REGIONS)}")
        column = quantity if region is None else f"{region}_{quantity}"
        if column not in self.frames:
            known = [name for name in map(str, self.frames) if region is None or name.startswith(f"{region}_")]
            raise ValueError(f"there is no quantity {column}: the quantities are {', '.join(known)}")
        if points < 2:
            raise ValueError(f"points = {points}: expected at least 2")
        if self.steps.empty:
            return np.empty((0, points))
        values = self.frames[column].to_numpy(float)
        first, count = self._stances()
        frames = first[:, None] + (count - 1)[:, None] * np.linspace(0.0, 1.0, points)
        curves: npt.NDArray[np.float64] = np.interp(frames, np.arange(len(values)), values)
        return curves

    @property
    def _period_s(self) -> float:
        """The frame period of the insole, s. It is rounded to whole microseconds, so the times of an insole drift from those of
        a recording with a period that is not a whole number of microseconds."""
        # Half a microsecond is rounded up, as on the insole; `round` would round it to the even number.
        return math.floor(1e6 / self.recording.rate_hz + 0.5) / 1e6

    def plot(self, step: int | None = None) -> Figure:
        """Draws the measured and the model force of the regions in a step, by default in the first step."""
        from plantar import plots

        return plots.step(self, step)

    def plot_pressure(self, step: int | None = None) -> Figure:
        """Draws the peak pressure of each cell in a step or, by default, its mean over the steps: ``cell_peaks_kpa``, in the form
        of ``Recording.plot``."""
        from plantar import plots

        return plots.peaks(self, step)
