"""Reads an exported file with an independent library or program, and prints its content as JSON.

Arguments: the reader (ezc3d, c3d, opensim, scipy, pandas, bids or mcap) and the path. The object has these keys, as far as the
format or the reader has them:

- `rate_hz`: the rate in Hz
- `t_s`: the times in s
- `channels`: the values of each channel by its name, with null for an absent value
- `units`: the unit of each channel by its name
- `events`: pairs of a time in s and a name
- `event_count`, `frames`: the numbers of events and of frames that the file states
- `start_s`, `sources`: the time of the first frame on the clock of the recordings, and the provenance of each foot
- `feet`: for each side: the layout (or only the positions) of the cells, their pressures, the steps, the source, and the times
  of the events
- `errors`, `warnings`: the findings of the validator of BIDS
"""

import json
import subprocess
import sys
from pathlib import Path

import numpy as np

REGIONS = [
    "heel", "posterior_midfoot", "anterior_midfoot", "metatarsals_12", "metatarsals_35", "hallux", "toe_2", "toes_35",
]
EVENTS = {"Foot Strike": "heel_strike", "Foot Off": "toe_off"}


def plain(values):
    """The values as a flat list of numbers, with None for NaN."""
    return [None if np.isnan(value) else float(value) for value in np.asarray(values, float).ravel()]


def events(times, contexts, labels):
    """Pairs of a time in s and a name, from pairs of minutes and seconds, the feet and the kinds of the events."""
    named = zip(np.asarray(times, float).reshape(-1, 2), contexts, labels, strict=True)
    return [[minutes * 60 + seconds, f"{context.lower()}_{EVENTS[label]}"] for (minutes, seconds), context, label in named]


def in_parts(name, get):
    """The values of a parameter and of its continuations, which have the suffixes 2, 3 and so on."""
    values = list(get(name))
    number = 2
    while (more := get(f"{name}{number}")) is not None:
        values.extend(more)
        number += 1
    return values


def provenance(get):
    """The start time and the sources in the group PLANTAR of a C3D file, of which `get` returns the texts of a parameter."""
    sources = {side: get(f"SOURCE_{side.upper()}") for side in ("left", "right")}
    return {
        "start_s": float(get("START_S")[0]),
        "sources": {side: " ".join(text.strip() for text in texts) for side, texts in sources.items() if texts is not None},
    }


def read_ezc3d(path):
    import ezc3d

    file = ezc3d.c3d(str(path))
    analog, event, own = (file["parameters"][group] for group in ("ANALOG", "EVENT", "PLANTAR"))
    get = lambda name: np.asarray(event[name]["value"]).T if name in event else None
    times = in_parts("TIMES", get)
    values = file["data"]["analogs"][0]
    return {
        "rate_hz": analog["RATE"]["value"][0],
        "channels": dict(zip(analog["LABELS"]["value"], map(plain, values), strict=True)),
        "units": dict(zip(analog["LABELS"]["value"], analog["UNITS"]["value"], strict=True)),
        "events": events(times, in_parts("CONTEXTS", get), in_parts("LABELS", get)),
        "event_count": int(event["USED"]["value"][0]),
        "frames": int(file["header"]["points"]["last_frame"] - file["header"]["points"]["first_frame"] + 1),
        **provenance(lambda name: own[name]["value"] if name in own else None),
    }


def read_c3d(path):
    import c3d

    with open(path, "rb") as handle:
        file = c3d.Reader(handle)
        samples = np.concatenate([analog for _, _, analog in file.read_frames()], axis=1)
        labels = [label.strip() for label in file.analog_labels]

        def get(name):
            parameter = file.get(f"EVENT:{name}")
            if parameter is None or parameter.num_elements == 0:
                return None if parameter is None else []
            return parameter.float_array.reshape(-1, 2) if name.startswith("TIMES") else parameter.string_array

        def own(name):
            parameter = file.get(f"PLANTAR:{name}")
            return None if parameter is None else parameter.string_array

        strip = lambda texts: [text.strip() for text in texts]
        return {
            "rate_hz": float(file.analog_rate),
            "channels": dict(zip(labels, map(plain, samples), strict=True)),
            "units": dict(zip(labels, strip(file.get("ANALOG:UNITS").string_array), strict=True)),
            "events": events(in_parts("TIMES", get), strip(in_parts("CONTEXTS", get)), strip(in_parts("LABELS", get))),
            "event_count": int(file.get("EVENT:USED").uint16_value),
            "frames": int(file.frame_count),
            **provenance(own),
        }


def read_opensim(path):
    import opensim

    opensim.Logger.setLevelString("Error")
    table = opensim.TimeSeriesTable(str(path))
    values = table.getMatrix().to_numpy()
    return {
        "t_s": plain(table.getIndependentColumn()),
        "channels": {label: plain(values[:, i]) for i, label in enumerate(table.getColumnLabels())},
    }


def read_scipy(path):
    from scipy.io import loadmat

    file = loadmat(path, simplify_cells=True)
    assert list(file["regions"]) == REGIONS
    found = {"rate_hz": file["rate_hz"], "t_s": plain(file["t_s"]), "channels": {}, "feet": {}}
    for side in ("left", "right"):
        if side not in file:
            continue
        foot = file[side]
        channels = {"total_force_n": foot["total_force_n"]}
        channels |= {f"cop_{axis}_mm": foot["cop_mm"][:, i] for i, axis in enumerate("xy")}
        channels |= {f"{region}_measured_force_n": foot["measured_force_n"][:, i] for i, region in enumerate(REGIONS)}
        channels |= {f"{region}_area_mm2": foot["area_mm2"][:, i] for i, region in enumerate(REGIONS)}
        found["channels"] |= {f"{side}_{name}": plain(values) for name, values in channels.items()}
        found["feet"][side] = {
            "pressure_kpa": plain(foot["pressure_kpa"]),
            "layout": {name: plain(foot["layout"][name]) for name in ("x_mm", "y_mm", "area_mm2", "region")},
            "steps": {name: plain(values) for name, values in foot["steps"].items()},
            "source": foot["source"],
            "heel_strike_s": plain(foot["heel_strike_s"]),
            "toe_off_s": plain(foot["toe_off_s"]),
        }
    return found


def read_pandas(path):
    import pandas

    table = pandas.read_csv(path)
    is_event = table.quantity.isin(list(EVENTS.values()))
    rows = table[is_event]
    table = table[~is_event]
    prefix = table.region.where(table.region != "foot", "").map(lambda region: region and region + "_")
    wide = table.assign(channel=table.side + "_" + prefix + table.quantity).pivot(index="t_s", columns="channel", values="value")
    return {
        "t_s": plain(wide.index),
        "channels": {name: plain(wide[name]) for name in wide},
        "events": [[row.t_s, f"{row.side}_{row.quantity}"] for row in rows.itertuples()],
    }


def read_bids(path):
    import pandas

    validator = Path(sys.executable).parent / "bids-validator-deno"
    # The exit status is not checked: it only states whether there are findings, which the test evaluates.
    report = subprocess.run([validator, path, "--format", "json", "--max-rows", "-1"], stdout=subprocess.PIPE)
    issues = json.loads(report.stdout)["issues"]["issues"]
    motion = next(Path(path).glob("sub-*/motion"))
    table = lambda suffix: next(motion.glob(f"*_{suffix}.tsv"))
    channels = pandas.read_csv(table("channels"), sep="\t", keep_default_na=False)
    samples = pandas.read_csv(table("motion"), sep="\t", header=None, na_values="n/a")
    event_table = pandas.read_csv(table("events"), sep="\t")
    sidecar = json.loads(next(motion.glob("*_motion.json")).read_text())
    return {
        "rate_hz": sidecar["SamplingFrequency"],
        "start_s": sidecar["RecordingStartTime"],
        "channels": {name: plain(samples[i]) for i, name in enumerate(channels.name)},
        "units": dict(zip(channels.name, channels.units)),
        "events": [[row.onset, row.trial_type] for row in event_table.itertuples()],
        "errors": [issue for issue in issues if issue["severity"] == "error"],
        "warnings": [issue for issue in issues if issue["severity"] == "warning"],
    }


def read_mcap(path):
    from mcap.reader import make_reader

    messages, units = {}, {}
    with open(path, "rb") as handle:
        reader = make_reader(handle, validate_crcs=True)
        metadata = {record.name: record.metadata for record in reader.iter_metadata()}
        for schema, channel, message in reader.iter_messages():
            assert channel.message_encoding == "json" and schema.encoding == "jsonschema"
            properties = json.loads(schema.data)["properties"]
            content = json.loads(message.data)
            assert content.keys() <= properties.keys()
            messages.setdefault(channel.topic, []).append((message.log_time, content))
            if schema.name == "plantar.Frame":
                side = channel.topic.split("/")[1]
                units |= {f"{side}_{name}": schema_of["description"].split(", ")[-1] for name, schema_of in properties.items()}
    found = {"rate_hz": float(metadata["plantar"]["rate_hz"]), "channels": {}, "units": units, "events": [], "feet": {}}
    for topic, topic_messages in messages.items():
        _, side, kind = topic.split("/")
        foot = found["feet"].setdefault(side, {"source": metadata["plantar"][f"{side}_source"]})
        times_s = [log_time / 1e9 for log_time, _ in topic_messages]
        contents = [content for _, content in topic_messages]
        if kind == "frame":
            # The frames of both feet have the same times.
            assert found.setdefault("t_s", times_s) == times_s
            names = (name[len(side) + 1 :] for name in units if name.startswith(side))
            found["channels"] |= {f"{side}_{name}": [content.get(name) for content in contents] for name in names}
        elif kind == "pressure":
            foot |= read_clouds(contents, times_s)
        elif kind == "step":
            foot["steps"] = contents
        else:
            found["events"] += [[t_s, f"{side}_{content['event']}"] for t_s, content in zip(times_s, contents)]
    return found


def read_clouds(clouds, times_s):
    """The points of the first foxglove.PointCloud, and the pressures of all point clouds."""
    import base64

    pressures = []
    for cloud, t_s in zip(clouds, times_s, strict=True):
        assert abs(cloud["timestamp"]["sec"] + cloud["timestamp"]["nsec"] / 1e9 - t_s) < 1e-9
        # The type 7 of Foxglove is a float with 32 bits.
        assert all(field["type"] == 7 for field in cloud["fields"])
        layout = {
            "names": [field["name"] for field in cloud["fields"]],
            "formats": ["<f4"] * len(cloud["fields"]),
            "offsets": [field["offset"] for field in cloud["fields"]],
            "itemsize": cloud["point_stride"],
        }
        points = np.frombuffer(base64.b64decode(cloud["data"]), dtype=layout)
        pressures.extend(points["pressure_kpa"])
        if len(pressures) == len(points):
            first = {f"{axis}_m": plain(points[axis]) for axis in "xyz"}
    return first | {"pressure_kpa": plain(pressures)}


json.dump(globals()[f"read_{sys.argv[1]}"](sys.argv[2]), sys.stdout)
