"""The measures of both feet in NumPy, computed directly from their definitions in docs/measures.md.

Reads from the standard input, as JSON, the steps of the "left" and of the "right" foot in the order of time: number (steps only;
load bouts and alerts are not counted), heel strike (s), stance time (s), peak force (N) and force-time integral (N s). Prints a
JSON object: for each measure of each foot, each symmetry index and the cadence, a list of the number of values, their mean and
standard deviation, and the two limits of the 95 % confidence interval of the mean. What cannot be computed is null.
"""

import json
import sys

import numpy as np
from scipy import stats

data = json.load(sys.stdin)
# The longest stride time that counts, from the stride times of both feet, as in docs/measures.md.
times_s = [
    after[1] - before[1]
    for steps in (data["left"], data["right"])
    for before, after in zip(steps, steps[1:])
    if after[0] == before[0] + 1
]
LONGEST_STRIDE_S = max(2.5, 2 * sorted(times_s)[len(times_s) // 2]) if times_s else 2.5
SYMMETRIC = ["step_time_s", "stance_time_s", "swing_time_s", "peak_force_n", "force_integral_n_s"]


def estimate(values, consecutive):
    """The estimate of a mean: number of values, mean, standard deviation, and the limits of the 95 % interval.

    consecutive[i] is true if the stride of value i directly follows that of value i - 1.
    """
    x = np.array(values, float)
    n = len(x)
    if n < 2:
        return None if n == 0 else [n, x[0], None, None, None]
    d = x - x.mean()
    # Correlation of successive values, corrected for its bias, and the number of independent values with the same variance
    # of the mean.
    products = [d[i - 1] * d[i] for i in range(1, n) if consecutive[i]]
    r = np.mean(products) / np.mean(d**2) if products else 0.0
    r = max(0.0, r + (1 + 4 * r) / n)
    independent = n * (1 - r) / (1 + r)
    if independent < 3:
        return [n, x.mean(), x.std(ddof=1), None, None]
    half_width = stats.t.ppf(0.975, independent - 1) * x.std(ddof=1) / np.sqrt(independent)
    return [n, x.mean(), x.std(ddof=1), x.mean() - half_width, x.mean() + half_width]


def uncovered(start, end, steps):
    """The part of the time from start to end in which none of the steps takes place."""
    time, at = 0.0, start
    for _, strike, stance, *_ in sorted(steps, key=lambda step: step[1]):
        time += max(0.0, min(strike, end) - at)
        at = min(max(at, strike + stance), end)
    return time + end - at


def strides(own, other):
    """The strides of a foot: start, start of the other foot's step, end, and the measures by name."""
    found = []
    for (number, start, stance, peak, integral), (next_number, end, *_) in zip(own, own[1:]):
        between = [k for k, step in enumerate(other) if start < step[1] < end]
        if next_number != number + 1 or end - start > LONGEST_STRIDE_S or stance >= end - start or len(between) != 1:
            continue
        k = between[0]
        strike = other[k][1]
        stride = end - start
        if abs((strike - start) / stride - 0.5) > 0.35:
            continue
        is_known = k > 0 and other[k][0] == other[k - 1][0] + 1 and strike - other[k - 1][1] <= LONGEST_STRIDE_S
        before = other[k - 1 : k] if is_known else []
        measures = {
            "stride_time_s": stride,
            "step_time_s": end - strike,
            "stance_time_s": stance,
            "swing_time_s": end - (start + stance),
            "stance_percent": stance / stride * 100,
            "swing_percent": (stride - stance) / stride * 100,
            # Without a foot on the ground.
            "flight_s": uncovered(start, end, [(number, start, stance), *before, other[k]]),
            "peak_force_n": peak,
            "force_integral_n_s": integral,
        }
        if before:
            toe_off = other[k - 1][1] + other[k - 1][2]
            # The times of the stance in which the other foot is on the ground: until its toe off, and from its heel strike.
            overlap = lambda a, b: max(0.0, min(b, start + stance) - max(a, start))
            both = overlap(-np.inf, toe_off) + overlap(strike, strike + other[k][2])
            measures["first_double_support_s"] = overlap(-np.inf, toe_off)
            measures |= {"double_support_s": both, "double_support_percent": both / stride * 100}
            measures |= {"single_support_s": stance - both, "single_support_percent": (stance - both) / stride * 100}
        found.append((start, strike, end, measures))
    return found


def follows(list_of_strides, i):
    """True if stride i begins at the end of the stride before it."""
    return i > 0 and list_of_strides[i - 1][2] == list_of_strides[i][0]


left, right = strides(data["left"], data["right"]), strides(data["right"], data["left"])
result = {}
for side, found in (("left", left), ("right", right)):
    for key in {key for stride in found for key in stride[3]}:
        # Two values are consecutive only if they are those of consecutive strides.
        chosen = [(s[3][key], follows(found, i) and key in found[i - 1][3]) for i, s in enumerate(found) if key in s[3]]
        result[f"{side} {key}"] = estimate(*zip(*chosen)) if chosen else None
by_start = {s[0]: (s, follows(right, i)) for i, s in enumerate(right)}
for key in SYMMETRIC:
    pairs = []
    for i, (_, strike, _, ours) in enumerate(left):
        if strike in by_start:
            (_, _, _, theirs), consecutive = by_start[strike]
            a, b = ours[key], theirs[key]
            pairs.append((200 * (a - b) / (a + b), consecutive and follows(left, i)))
    result[f"symmetry {key}"] = estimate(*zip(*pairs)) if pairs else None
both = sorted(left + right, key=lambda s: s[0])
cadence = [120 / s[3]["stride_time_s"] for s in both]
result["cadence"] = estimate(cadence, [i > 0 and both[i][0] - both[i - 1][0] <= LONGEST_STRIDE_S for i in range(len(both))])
json.dump(result, sys.stdout)
