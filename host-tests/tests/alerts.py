"""Cumulative load and alerts, from the largest cell pressure of each region in every frame. alerts.rs compares the insole's
code with this independent implementation.

Reads a JSON object from the standard input: rate_hz, peaks_kpa (one list for each region), and the rules. Writes a JSON object
with the totals of each region, and for each alert the end of its second (s) and two bit masks in which bit i is region i: the
regions under sustained load, and the regions whose dose has reached its limit and was not in an earlier alert.
"""

import json
import sys

import numpy as np

given = json.load(sys.stdin)
rate, window = given["rate_hz"], given["window_s"]
peaks = np.array(given["peaks_kpa"])
seconds = peaks.shape[1] // rate
peaks = peaks[:, : seconds * rate].reshape(8, seconds, rate)

dose = np.cumsum(np.maximum(peaks - given["dose_kpa"], 0).sum(axis=2) / rate, axis=1)
squared = (peaks**2).sum(axis=(1, 2)) / rate
above = (peaks >= given["sustained_kpa"]).mean(axis=2)
# For each second, the share of the window up to its end with at least the pressure of sustained load; the time before the first
# frame is unloaded.
padded = np.concatenate([np.zeros((8, window)), np.cumsum(above, axis=1)], axis=1)
share = (padded[:, window:] - padded[:, :-window]) / window

sustained = np.zeros((8, seconds), bool)
for second in range(seconds):
    before = sustained[:, second - 1] if second else np.zeros(8, bool)
    begins = share[:, second] >= given["sustained_percent"] / 100 - 1e-9
    remains = before & (share[:, second] >= given["relieved_percent"] / 100 - 1e-9)
    sustained[:, second] = begins | remains

# `announced` has the regions whose dose has already raised an alert.
alerts, silent_until, announced = [], 0, np.zeros(8, bool)
for second in range(seconds):
    over = (dose[:, second] >= given["dose_kpa_s"]) & (given["dose_kpa_s"] > 0) & ~announced
    if (sustained[:, second].any() or over.any()) and second >= silent_until and len(alerts) < given["per_day"]:
        bits = lambda regions: int(sum(1 << i for i in np.flatnonzero(regions)))
        alerts.append([second + 1, bits(sustained[:, second]), bits(over)])
        # Only the pause after an alert is simulated, and no snooze on request.
        silent_until = second + given["pause_s"]
        announced |= over

json.dump(
    {
        "dose_kpa_s": dose[:, -1].tolist(),
        "squared_kpa2_s": squared.tolist(),
        "sustained_s": sustained.sum(axis=1).tolist(),
        "alerts": alerts,
    },
    sys.stdout,
)
