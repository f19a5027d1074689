"""The search of the paper (docs/identification.md, `--method paper`) through SciPy's SLSQP, for comparison: it minimises
the paper's Eq. 18, the squared difference of model and measured force, with the penalty of Eq. 19 for negative forces,
over eight bounded variables, from ten random starts.

The search varies the logarithms of k and c, because it rarely converges otherwise. The argument is a folder with one file
of doubles for each region, 0.f64 to 7.f64. A file has the number of samples; then for each sample: the area (m2), the
indices of the later and the earlier sample from which the deformation rate is computed, the reciprocal of the time
between these two (1/s), and the measured force (N); and at the end the area before contact (m2), which has the index
after the last sample. The script prints a line for each region: seconds, model evaluations and the least NRMSE.
"""

import os
import pathlib
import sys
import time

# The identification in Rust is measured on one core, too.
os.environ["OPENBLAS_NUM_THREADS"] = "1"

import numpy as np
from scipy.optimize import minimize

STARTS = 10
# A, B, C and d0 in m, ln(k / (N/m3)), n, ln(c / (N s/m3)), m.
BOUNDS = [
    (0.002, 0.08), (0.002, 0.08), (0.002, 0.03), (0.004, 0.025),
    (11.5, 25.3), (0.0, 5.0), (6.9, 23.0), (0.0, 5.0),
]
# The factor P of Eq. 19 (1/N): a negative (tensile) force F counts as F + P F^2 in the residual.
PENALTY_PER_N = 1.0


def force(x, area, later, earlier, per_s):
    """The model force of each sample, which may be negative (tensile). `x` has the variables in the order of BOUNDS."""
    a, b, c_m, d0, k, n, c, m = x
    k, c = np.exp(k), np.exp(c)
    ratio = np.clip(area / (np.pi * a * b), 0.0, 1.0)
    d = c_m * (1.0 - np.sqrt(1.0 - ratio))
    rate = (d[later] - d[earlier]) * per_s
    d = d[:-1]
    with np.errstate(divide="ignore", invalid="ignore"):
        elastic = k * (d / d0) ** n * d * (1.0 - d / (3.0 * c_m))
        shape = (6.0 * c_m**2 - 4.0 * c_m * d + d**2) / (3.0 * c_m * (2.0 * c_m - d))
        viscous = c * (d / d0) ** m * rate * shape
        total = np.pi * a * b * d / c_m * (elastic + viscous)
    return np.where(d > 0.0, total, 0.0)


def penalised(force_n):
    """The forces (N) with the penalty for negative ones (Eq. 19 as printed)."""
    return np.where(force_n < 0.0, force_n + PENALTY_PER_N * force_n**2, force_n)


for region in range(8):
    data = np.fromfile(pathlib.Path(sys.argv[1]) / f"{region}.f64")
    count = int(data[0])
    table = data[1 : 1 + 5 * count].reshape(count, 5)
    area = np.append(table[:, 0], data[1 + 5 * count])
    later, earlier = table[:, 1].astype(int), table[:, 2].astype(int)
    per_s, measured = table[:, 3], table[:, 4]
    scale = measured.max() ** 2 * count
    evaluations = 0

    def squares(x):
        """The mean squared residual, relative to the squared peak force: the square of the NRMSE, with the penalty."""
        global evaluations
        evaluations += 1
        return np.sum((penalised(force(x, area, later, earlier, per_s)) - measured) ** 2) / scale

    generator = np.random.default_rng(region)
    best = np.inf
    start = time.perf_counter()
    for _ in range(STARTS):
        x = [low + generator.random() * (high - low) for low, high in BOUNDS]
        result = minimize(squares, x, method="SLSQP", bounds=BOUNDS, options={"maxiter": 200, "ftol": 1e-9})
        # As on the device, a tensile force is set to 0.
        model = np.maximum(force(result.x, area, later, earlier, per_s), 0.0)
        if np.all(np.isfinite(model)):
            best = min(best, np.sqrt(np.sum((model - measured) ** 2) / scale))
    print(time.perf_counter() - start, evaluations, best)
