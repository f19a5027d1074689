"""Figures of a foot, a step and a fit, with matplotlib."""

from __future__ import annotations

from collections.abc import Iterator

import matplotlib.pyplot as plt
import numpy as np
import numpy.typing as npt
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.collections import PatchCollection
from matplotlib.figure import Figure
from matplotlib.patches import Rectangle

from plantar.fitting import Fit
from plantar.recording import REGIONS, Recording, Replay

_MEASURED = "0.35"
"""Colour of the measured force: dark grey."""
_MODEL = "tab:red"
"""Colour of the model force."""
_MARGIN_MM = 70.0
"""Width of the space for the names of the regions on each side of a foot."""
_NAME_MM = 9.0
"""Least distance between the names of two regions on the same side of a foot. A line of text is about 8 mm high at the scale of
the figure."""


def foot(recording: Recording, peak_kpa: npt.NDArray[np.float32], title: str) -> Figure:
    """A pressure of each cell of the recording, in foot coordinates, with the names of the regions. The squares have the areas of
    the cells, but not their shapes. The colours begin at 0 kPa."""
    cells = recording.cells
    side_mm = np.sqrt(cells["area_mm2"].to_numpy())
    places = zip(cells["x_mm"] - side_mm / 2, cells["y_mm"] - side_mm / 2, side_mm, strict=True)
    squares = PatchCollection([Rectangle((x_mm, y_mm), size_mm, size_mm) for x_mm, y_mm, size_mm in places], cmap="viridis")
    squares.set_array(peak_kpa)
    # From 0, so that the colours of two figures differ only in the upper end of their scale.
    squares.set_clim(0.0, max(float(peak_kpa.max()), 1.0))
    figure, axes = plt.subplots(figsize=(6.0, 7.0), layout="constrained")
    axes.add_collection(squares)
    edges_mm = (float(cells["x_mm"].min()) - side_mm.max(), float(cells["x_mm"].max()) + side_mm.max())
    middle_mm = sum(edges_mm) / 2
    # A right foot seen from above has its lateral side on the right, a left foot on the left.
    margins_mm = (edges_mm[0] - _MARGIN_MM, edges_mm[1] + _MARGIN_MM)
    axes.set_xlim(margins_mm if recording.side == "right" else margins_mm[::-1])
    axes.set_ylim(float(cells["y_mm"].min()) - side_mm.max(), float(cells["y_mm"].max()) + side_mm.max())
    # The names are beside the foot, so that they do not hide cells.
    centres_mm = cells.groupby("region", observed=True, sort=False)[["x_mm", "y_mm"]].mean()
    for is_lateral, beside_mm in centres_mm.groupby(centres_mm["x_mm"] > middle_mm):
        is_left = is_lateral != (recording.side == "right")
        name_y_mm = _spread(beside_mm["y_mm"].to_numpy(), _NAME_MM)
        for (region, centre_mm), y_mm in zip(beside_mm.iterrows(), name_y_mm, strict=True):
            axes.annotate(
                _title(str(region)),
                (centre_mm["x_mm"], centre_mm["y_mm"]),
                (edges_mm[bool(is_lateral)], y_mm),
                fontsize=8,
                va="center",
                ha="right" if is_left else "left",
                arrowprops={"arrowstyle": "-", "color": "0.6", "linewidth": 0.6},
            )
    axes.set(aspect="equal", xlabel="to the lateral side, mm", ylabel="from heel to toes, mm")
    axes.set_title(title)
    figure.colorbar(squares, ax=axes, label="kPa", shrink=0.6)
    return figure


def step(replay: Replay, number: int | None = None) -> Figure:
    """The measured force and the live model force of the regions in a step, by default in the first step."""
    numbers = _numbers(replay, number)
    number = numbers[0] if number is None else number
    # Start and duration are the same in the rows of all regions of a step.
    row = replay.steps.xs(number, level="step").iloc[0]
    first = int(replay.recording.t_s.searchsorted(row["start_s"]))
    length = round(row["duration_s"] / replay._period_s)
    frames = replay.frames.iloc[first : first + length + 1]
    t_s = frames.index.to_numpy() - frames.index[0]
    figure, panels = _panels("time since heel strike, s")
    for region, axes in panels:
        axes.plot(t_s, frames[f"{region}_measured_force_n"], color=_MEASURED, label="measured")
        axes.plot(t_s, frames[f"{region}_model_force_n"], color=_MODEL, label="model")
    axes.legend(fontsize=8)
    figure.suptitle(f"Step {number}, {replay.recording.side} foot: measured force, and model force of the live stream")
    return figure


def peaks(replay: Replay, number: int | None = None) -> Figure:
    """The peak pressure of each cell in a step, or its mean over all steps."""
    numbers = _numbers(replay, number)
    table, side = replay.cell_peaks_kpa, replay.recording.side
    if number is None:
        title = f"Peak pressure, mean of {len(numbers)} steps, {side} foot"
        return foot(replay.recording, table.mean().to_numpy(), title)
    return foot(replay.recording, table.loc[number].to_numpy(), f"Peak pressure, step {number}, {side} foot")


def _numbers(replay: Replay, number: int | None) -> list[int]:
    """The numbers of the steps. Raises an error if there is no step or, unless ``number`` is ``None``, no step with this number."""
    if number is not None and not isinstance(number, int | np.integer):
        raise TypeError(f"step = {number!r}: expected a whole number or None")
    numbers = [int(each) for each in replay.steps.index.unique("step")]
    if not numbers:
        raise ValueError(f"{replay.recording.path} has no complete step: record a walk of several steps")
    if number is not None and number not in numbers:
        # Steps, load bouts and alerts are numbered in one sequence, so a number between those of two steps can be missing.
        ranges = _ranges(numbers)
        reason = "; the load bouts and alerts between them are no steps" if len(ranges) > 1 else ""
        raise ValueError(f"there is no step {number}: the steps are {', '.join(ranges)}{reason}")
    return numbers


def _ranges(numbers: list[int]) -> list[str]:
    """The numbers, which increase, as texts such as ``3`` and ``5 to 9``."""
    runs: list[list[int]] = []
    for number in numbers:
        if runs and number == runs[-1][-1] + 1:
            runs[-1].append(number)
        else:
            runs.append([number])
    return [f"{run[0]} to {run[-1]}" if len(run) > 1 else str(run[0]) for run in runs]


def fit(fitted: Fit) -> Figure:
    """The measured force and the model force of each region over all steps, with K, n and the predicted error. A region without
    a prediction has the error of the fit instead."""
    table, curves = fitted.table(), fitted.curves
    figure, panels = _panels("time since contact, s")
    for region, axes in panels:
        row = table.loc[region]
        if not row["fitted"]:
            axes.text(0.5, 0.5, "not fitted", transform=axes.transAxes, ha="center", color="0.5")
            continue
        for index, (_, curve) in enumerate(_steps(curves, region)):
            first = index == 0
            axes.plot(curve["t_s"], curve["measured_force_n"], color=_MEASURED, lw=0.6, label="measured" if first else None)
            axes.plot(curve["t_s"], curve["model_force_n"], color=_MODEL, lw=0.6, label="model" if first else None)
        axes.legend(fontsize=7, loc="upper right")
        kind: str = "fitted" if pd.isna(row["nrmse_predicted_percent"]) else "predicted"
        error_percent = row[f"nrmse_{kind}_percent"]
        text = f"K {row['stiffness_pa'] / 1e3:.3g} kPa, n {row['n']:.2f}\nNRMSE, {kind}: {error_percent:.1f} %"
        axes.text(0.02, 0.97, text, transform=axes.transAxes, va="top", fontsize=7)
        # Leaves space for the text above the curves.
        axes.set_ylim(0, axes.get_ylim()[1] * 1.35)
    name = fitted.results["participant"]
    figure.suptitle(f"Tissue of {name}: measured force, and model force with one set of parameters")
    return figure


def _spread(places: npt.NDArray[np.float64], distance: float) -> npt.NDArray[np.float64]:
    """Moves the places, in the same order along the axis, so that neighbours are at least ``distance`` apart."""
    order = np.argsort(places, kind="stable")
    # Least squares with the condition that neighbours are far enough apart: rank times the distance is subtracted from each
    # place, and the results must not decrease (isotonic regression). Places that would decrease form a group and all have its
    # mean, so that the group as a whole is not moved. A group that reaches the one before is merged with it.
    groups: list[list[float]] = []
    for rank, place in enumerate(places[order]):
        groups.append([place - rank * distance])
        while len(groups) > 1 and np.mean(groups[-2]) > np.mean(groups[-1]):
            groups[-2:] = [groups[-2] + groups[-1]]
    means = np.concatenate([np.full(len(group), np.mean(group)) for group in groups])
    spread = np.empty(len(places))
    spread[order] = means + np.arange(len(places)) * distance
    return spread


def _steps(curves: pd.DataFrame, region: str) -> Iterator[tuple[object, pd.DataFrame]]:
    """The curves of a region, one table for each step."""
    return iter(curves[curves["region"] == region].groupby(["recording", "step"]))


def _panels(x_label: str) -> tuple[Figure, list[tuple[str, Axes]]]:
    """A figure with one panel for each region."""
    figure, grid = plt.subplots(2, 4, figsize=(13, 6), layout="constrained", squeeze=False)
    panels = list(zip(REGIONS, grid.flat, strict=True))
    for region, axes in panels:
        axes.set_title(_title(region), fontsize=10)
        axes.set_ylabel("force, N", fontsize=8)
        axes.tick_params(labelsize=8)
    for axes in grid[1]:
        axes.set_xlabel(x_label, fontsize=8)
    return figure, panels


def _title(region: str) -> str:
    """The name of a region in words."""
    words = {"metatarsals_12": "metatarsals 1-2", "metatarsals_35": "metatarsals 3-5", "toes_35": "toes 3-5"}
    return words.get(region, region.replace("_", " "))
