"""Receives all streams of the Lab Streaming Layer whose names begin with plantar_.

Reads one JSON object from each line of the standard input, and answers with one. {"streams": N} resolves N streams, opens them
and answers with their descriptions. {"first": S} waits for the first sample of each stream, up to S seconds for each, and
answers with the number of streams that have none. {"last": {NAME: VALUE}} receives until the first value of the last sample of
each named stream is VALUE, and then the events up to the toe off of the last step of each foot. It answers with all samples so
far of each stream as [[time, [values]], ...], and with the times of LSL and of the computer at one moment.
"""

import json
import sys
import time
from collections.abc import Callable

import pylsl

# Timeout for finding and opening the streams, and for each further sample.
LIMIT_S = 30.0


def description(info: pylsl.StreamInfo) -> dict:
    """The properties of a stream, and the descriptions of its channels."""
    channels, channel = [], info.desc().child("channels").child("channel")
    while not channel.empty():
        channels.append({name: channel.child_value(name) for name in ("label", "unit", "type", "meaning", "region")})
        channel = channel.next_sibling()
    names = ("side", "serial_number", "board", "firmware", "cells", "frame_rate_hz", "contact_on_kpa")
    return {
        "type": info.type(),
        "source_id": info.source_id(),
        "rate_hz": info.nominal_srate(),
        "is_text": info.channel_format() == pylsl.cf_string,
        "count": info.channel_count(),
        "channels": channels,
        "properties": {name: info.desc().child_value(name) for name in names},
    }


def clock() -> tuple[float, float]:
    """The times of LSL and of the computer, s, from the fastest of several readings."""
    readings = []
    for _ in range(20):
        before_s, unix_s, after_s = pylsl.local_clock(), time.time(), pylsl.local_clock()
        readings.append((after_s - before_s, (before_s + after_s) / 2, unix_s))
    return min(readings)[1:]


inlets: dict[str, pylsl.StreamInlet] = {}
samples: dict[str, list] = {}


def pull(name: str, limit_s: float) -> bool:
    """Receives a sample; false if none arrives within the limit."""
    values, t_s = inlets[name].pull_sample(limit_s)
    if values is not None:
        # NaN, which is not equal to itself, becomes null.
        samples[name].append([t_s, [None if value != value else value for value in values]])
    return values is not None


def pull_until(name: str, is_last: Callable[[list], bool]) -> None:
    """Receives samples until `is_last` is true for one, which is a pair of time and values."""
    while not (samples[name] and is_last(samples[name][-1])):
        assert pull(name, LIMIT_S), f"{name}: no more samples after {len(samples[name])}"


for line in sys.stdin:
    request = json.loads(line)
    if "streams" in request:
        found = pylsl.resolve_bypred("starts-with(name, 'plantar_')", request["streams"], LIMIT_S)
        inlets = {info.name(): pylsl.StreamInlet(info) for info in found}
        samples = {name: [] for name in inlets}
        answer = {name: description(inlet.info(LIMIT_S)) for name, inlet in inlets.items()}
        for inlet in inlets.values():
            inlet.open_stream(LIMIT_S)
    elif "first" in request:
        answer = sum(not samples[name] and not pull(name, request["first"]) for name in inlets)
    else:
        for name, last in request["last"].items():
            pull_until(name, lambda sample, last=last: sample[1][0] == last)
        for side in ("left", "right"):
            last_step_s = samples[f"plantar_{side}_steps"][-1][0]
            pull_until(f"plantar_{side}_events", lambda sample, last_s=last_step_s: sample[0] > last_s)
        answer = {"samples": samples, "clock_s": clock()}
    print(json.dumps(answer), flush=True)
