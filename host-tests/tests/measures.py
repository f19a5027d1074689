"""The standard measures of steps in NumPy, computed directly from their definitions in docs/measures.md.

Reads from the standard input, as JSON: "rate_hz"; the "cells" with x and y (mm), area (mm2) and the index of the region; the
contact thresholds "on_kpa" and "off_kpa"; and for each of the "steps" the pressures (kPa) of all cells in the frames from heel
strike to toe off. Prints an array for each step: the measures of the foot, then those of the regions.
"""

import json
import sys

import numpy as np

data = json.load(sys.stdin)
rate_hz = data["rate_hz"]
x_mm, y_mm, area_mm2, region = np.array(data["cells"]).T


def areas(pressure_kpa):
    """Contact area of each region over time, mm2: a cell is in contact from on_kpa on until it is below off_kpa."""
    contact = np.zeros(pressure_kpa.shape, bool)
    before = np.zeros(pressure_kpa.shape[1], bool)
    for i, kpa in enumerate(pressure_kpa):
        before = np.where(before, kpa >= data["off_kpa"], kpa >= data["on_kpa"])
        contact[i] = before
    return np.stack([contact[:, region == r] @ area_mm2[region == r] for r in range(8)])


def loading_rate(force_n):
    """Slope of the force between 20 and 80 % of its first peak, N/s. The first peak is the first sample that is at least half of
    the largest force and is not exceeded in the next 50 ms. The region is unloaded in the sample before heel strike."""
    window = int(0.05 * rate_hz + 1e-9)
    peak = next(
        i for i, f in enumerate(force_n) if f >= 0.5 * force_n.max() and f >= force_n[i : i + window + 1].max()
    )
    rise, times = np.concatenate([[0.0], force_n[: peak + 1]]), []
    for level in (0.2 * force_n[peak], 0.8 * force_n[peak]):
        i = np.flatnonzero(rise < level)[-1]
        times.append(i + (level - rise[i]) / (rise[i + 1] - rise[i]))
    return 0.6 * force_n[peak] / (times[1] - times[0]) * rate_hz


def of_region(pressure_kpa, area, r):
    """The measures of region r, in the order of of_region in measures.rs. area is its contact area over time."""
    cells = region == r
    force_n = pressure_kpa[:, cells] @ area_mm2[cells] * 1e-3
    highest_kpa = pressure_kpa[:, cells].max(axis=1)
    if not area.any():
        return [0.0, 0.0, highest_kpa.sum() / rate_hz, 0.0, 0.0, 0.0]
    peak = force_n.argmax()
    return [
        highest_kpa.max(),
        highest_kpa.argmax() / rate_hz,
        highest_kpa.sum() / rate_hz,
        force_n[peak] / area[peak] * 1e3 if area[peak] > 0 else 0.0,
        loading_rate(force_n),
        np.flatnonzero(area)[0] / rate_hz,
    ]


def of_foot(pressure_kpa, area):
    """The measures of the foot, in the order of of_foot in measures.rs. area is the contact area of each region over time."""
    cell_n = pressure_kpa * area_mm2 * 1e-3
    total_n = cell_n.sum(axis=1)
    count, half = len(total_n), len(total_n) // 2
    first, second = total_n[:half].argmax(), half + total_n[half:].argmax()
    valley = first + total_n[first : second + 1].argmin()
    if total_n[valley] > 0.95 * min(total_n[first], total_n[second]):
        first = total_n.argmax()
        humps = [total_n[first], first / rate_hz, 0.0, 0.0, 0.0, 0.0]
    else:
        humps = [v for i in (first, valley, second) for v in (total_n[i], i / rate_hz)]
    path = np.stack([cell_n @ x_mm / total_n, cell_n @ y_mm / total_n], axis=1)
    position_at = lambda share: np.array([np.interp(share * (count - 1), range(count), path[:, k]) for k in (0, 1)])
    line = [position_at(share) for share in (0.1, 0.3, 0.5, 0.7, 0.9)]
    inner = [path[i] for i in range(count) if 0.1 <= i / (count - 1) <= 0.9]
    inner = np.array([line[0], *inner, line[-1]])
    length_mm = np.linalg.norm(np.diff(inner, axis=0), axis=1).sum()
    # The excursion of the path at two thirds of the foot's length, perpendicular to the line between its points at 10 and
    # 90 % of stance.
    level_mm = y_mm.min() + (y_mm.max() - y_mm.min()) * 2 / 3
    along = (line[-1] - line[0]) / np.linalg.norm(line[-1] - line[0])
    excursion = 0.0
    for (ax, ay), (bx, by) in zip(inner, inner[1:]):
        if ay < level_mm <= by:
            point = np.array([ax + (bx - ax) * (level_mm - ay) / (by - ay), level_mm])
            # The point of the line at the same level.
            on_line = line[0] + along * (level_mm - line[0][1]) / along[1]
            excursion = (point[0] - on_line[0]) * along[1]
    forefoot = (region == 3) | (region == 4)
    width_mm = x_mm[forefoot].max() - x_mm[forefoot].min()
    largest = area.max(axis=1)
    return [
        total_n.max(),
        *humps,
        total_n.sum() / rate_hz,
        *np.concatenate(line),
        length_mm,
        np.ptp(inner[:, 0]),
        length_mm / (0.8 * (count - 1) / rate_hz),
        excursion / width_mm,
        largest[1:3].sum() / largest[:5].sum(),
    ]


for step in data["steps"]:
    pressure_kpa = np.array(step)
    area = areas(pressure_kpa)
    print(json.dumps([of_foot(pressure_kpa, area), *(of_region(pressure_kpa, area[r], r) for r in range(8))]))
