"""A replay in vectorised NumPy, for comparison with the library.

It has the same stages: codes of the virtual sensor, calibration, contact with hysteresis, areas, forces, centres of
pressure, second moments, the live model, and for each step the model. Some results are not used: they count in the
time, because the library also computes them. Unlike the library, it smooths the area of a step as the paper does
(docs/model.md). The arguments are a folder with the data, the full scale of the sensor (kPa), the
exponent of its curve, and the frames per second. The pressures are in pressure.f32, or in a recording walk.parquet,
which pandas then reads as part of the replay. The script prints the seconds of the fastest of several
runs, the number of steps, and the peak live model force of each region (N).
"""

import os
import sys
import time
from pathlib import Path

folder, full_kpa, exponent, rate_hz = sys.argv[1], *map(float, sys.argv[2:5])
file = Path(folder, "walk.parquet")
if file.exists():
    import pandas
else:
    # Without a file, the library is measured on one core. This must precede the import of NumPy.
    os.environ["OPENBLAS_NUM_THREADS"] = "1"
import numpy as np

# Number of runs. The fastest one counts, as for the library.
RUNS = 5
# The sensor's code at full scale.
FULL_CODE = 16 * 4095
# ContactRule::COUNTED, and the thresholds of StanceRule::ABSOLUTE. The library is measured with StanceRule::ADAPTIVE, which
# finds the same number of steps in this walk: the benchmark checks it.
ON_KPA, OFF_KPA = 10.0, 7.5
STRIKE_N, RELEASE_N, MIN_SWING_S = 30.0, 20.0, 0.04

# For each cell: x (mm), y (mm), area (mm2), index of the region, gain. For each region: A B (m2), C (m), K (Pa), G (Pa s), n
# and m.
cells = np.fromfile(f"{folder}/cells.f32", np.float32).reshape(-1, 5)
force_laws = np.fromfile(f"{folder}/force_laws.f32", np.float32).reshape(8, 6).astype(np.float64)
x, y, area, region, gain = cells.T
membership = (region[:, None] == np.arange(8)).astype(np.float32)


def force(law, g, rate):
    """The model force (N) for the normalised deformation g, which is the deformation over C, and its rate (1/s)."""
    ab, _, stiffness, damping, n, m = law.T
    with np.errstate(divide="ignore", invalid="ignore"):
        f = np.pi * ab * (
            stiffness * g ** (n + 2) * (1 - g / 3)
            + damping * g ** (m + 1) * rate * (6 - 4 * g + g * g) / (3 * (2 - g))
        )
    return np.where(g > 0, np.maximum(f, 0), 0)


if not file.exists():
    pressure_kpa = np.fromfile(f"{folder}/pressure.f32", np.float32).reshape(-1, len(cells))


def replay():
    """The number of steps, and the peak live model force of each region (N)."""
    if file.exists():
        recorded_kpa = pandas.read_parquet(file).drop(columns="t_s").to_numpy(np.float32)
    else:
        recorded_kpa = pressure_kpa
    codes = np.rint(FULL_CODE * (recorded_kpa / np.float32(full_kpa)) ** np.float32(exponent)).astype(np.uint16)
    pressure = full_kpa * (codes.astype(np.float32) / FULL_CODE) ** np.float32(1 / exponent) * gain
    on, off = pressure >= ON_KPA, pressure >= OFF_KPA
    loaded = np.empty_like(on)
    state = np.zeros(len(cells), bool)
    for i in range(len(codes)):
        state = on[i] | (state & off[i])
        loaded[i] = state

    in_contact = loaded * area
    moments = [in_contact @ (membership * q[:, None]) for q in (np.ones_like(x), x, y, x * x, x * y, y * y)]
    forces_n = pressure * (area * np.float32(1e-3))
    force_n, force_x, force_y = (forces_n @ (membership * q[:, None]) for q in (np.ones_like(x), x, y))
    with np.errstate(divide="ignore", invalid="ignore"):
        centre_of_pressure = force_x / force_n, force_y / force_n

    area_mm2 = moments[0].astype(np.float64)
    padded = np.vstack([np.zeros((2, 8)), area_mm2])
    smoothed_m2 = (padded[2:] + padded[1:-1] + padded[:-2]) / 3e6
    ratio = np.clip(smoothed_m2 / (np.pi * force_laws[:, 0]), 0, 1)
    g = ratio / (1 + np.sqrt(1 - ratio))
    model_n = force(force_laws, g, np.diff(g, axis=0, prepend=0) * rate_hz)

    total = force_n.sum(axis=1)
    steps, first, last = [], None, None
    for i, n in enumerate(total):
        if first is None:
            first = last = i if n >= STRIKE_N else None
        elif n >= RELEASE_N:
            last = i
        elif i - last >= MIN_SWING_S * rate_hz:
            steps.append((first, last + 1))
            first = None
    records = []
    for begin, end in steps:
        for r in range(8):
            contact = np.flatnonzero(area_mm2[begin:end, r])
            if len(contact) == 0:
                continue
            a = area_mm2[begin + contact[0] : begin + contact[-1] + 1, r]
            measured = force_n[begin + contact[0] : begin + contact[-1] + 1, r]
            mean = np.convolve(np.pad(a, 1, "edge"), np.ones(3) / 3, "valid")
            t = np.linspace(-1, 1, len(a))
            smooth = np.polynomial.Polynomial.fit(t, mean, min(5, len(a) // 2 - 1))(t) if len(a) >= 4 else mean
            ratio = np.clip(smooth * 1e-6 / (np.pi * force_laws[r, 0]), 0, 1)
            g = ratio / (1 + np.sqrt(1 - ratio))
            rate = np.append(np.diff(g), g[-1] - g[-2] if len(g) > 1 else 0) * rate_hz
            model = force(force_laws[r], g, rate)
            records.append((measured.max(), model.max(), model.sum() / rate_hz, np.sqrt(np.mean((model - measured) ** 2))))
    return len(steps), model_n.max(axis=0)


best_s = float("inf")
for _ in range(RUNS):
    start = time.perf_counter()
    steps, peaks_n = replay()
    best_s = min(best_s, time.perf_counter() - start)
print(best_s, steps, *peaks_n)
