"""Least-squares fits of recorded steps by SciPy's trust region reflective algorithm: the best of several random starts.

Reads a JSON list of regions from the standard input. A region has three entries. "area_max_m2" is its largest area (m2).
"samples" contains for each sample the area (m2), the indices of the later and the earlier sample from which the deformation
rate is computed, the reciprocal of the time between these two (1/s) and the measured force (N); the index after the last sample
denotes the unloaded tissue. "steps" contains for each step the index of its first sample and the index after its last sample.
Prints one line for each region: the root mean square of the NRMSE of its steps, in percent, which the search minimises.
"""

import json
import os
import sys

os.environ["OPENBLAS_NUM_THREADS"] = "1"

import numpy as np
from scipy.optimize import least_squares

STARTS = 24
# Bounds of the variables: the largest area relative to pi A B, ln(K / Pa), G / (1e5 Pa s), n and m.
LOW = [0.12, np.log(1e4), 0.0, 0.0, 0.0]
HIGH = [0.999999, np.log(1e7), 10.0, 5.0, 5.0]


def force(x, share, later, earlier, per_s, area_max_m2):
    """Force (N) of all samples: Eq. 13 with Eq. 14 of the paper, as K and G times functions of the normalised deformation."""
    max_ratio, ln_k, g_1e5, n, m = x
    g = 1.0 - np.sqrt(np.clip(1.0 - share * max_ratio, 0.0, 1.0))
    rate = (g[later] - g[earlier]) * per_s
    g = g[:-1]
    safe = np.where(g > 0.0, g, 1.0)
    elastic = np.exp(ln_k) * safe ** (n + 2.0) * (1.0 - g / 3.0)
    viscous = g_1e5 * 1e5 * safe ** (m + 1.0) * rate * (6.0 - 4.0 * g + g * g) / (3.0 * (2.0 - g))
    section_m2 = area_max_m2 / max_ratio
    return np.where(g > 0.0, np.maximum(section_m2 * (elastic + viscous), 0.0), 0.0)


for region in json.load(sys.stdin):
    samples = np.array(region["samples"])
    share = np.append(samples[:, 0] / region["area_max_m2"], 0.0)
    later, earlier = samples[:, 1].astype(int), samples[:, 2].astype(int)
    per_s, measured = samples[:, 3], samples[:, 4]
    weight = np.zeros(len(samples))
    for start, end in region["steps"]:
        weight[start:end] = 1.0 / (measured[start:end].max() * np.sqrt(end - start))

    def residual(x):
        return (force(x, share, later, earlier, per_s, region["area_max_m2"]) - measured) * weight

    random = np.random.default_rng(1)
    best = min(
        (
            least_squares(residual, random.uniform(LOW, HIGH), bounds=(LOW, HIGH), x_scale=np.subtract(HIGH, LOW))
            for _ in range(STARTS)
        ),
        key=lambda found: found.cost,
    )
    squares = residual(best.x) ** 2
    print(100.0 * np.sqrt(squares.sum() / len(region["steps"])))
