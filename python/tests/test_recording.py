"""Recordings, replay and normalised steps, compared with pyarrow, NumPy and the command line."""

import dataclasses
import json
import os
import pathlib
import re
import sys
import threading
import warnings
from collections.abc import Callable
from typing import Any, Literal

import numpy as np
import pandas as pd
import pyarrow as pa
import pyarrow.compute as pc
import pyarrow.parquet as pq
import pytest
from conftest import plantar, walk

import plantar as package


def test_a_recording_has_the_values_of_its_file(walk_file: pathlib.Path) -> None:
    file = pq.read_table(walk_file)
    metadata = json.loads(file.schema.metadata[b"plantar"])
    recording = package.read(walk_file)
    assert (recording.side, recording.rate_hz) == (metadata["side"], metadata["rate_hz"])
    assert recording.source == metadata["source"]
    cells = pd.DataFrame(metadata["layout"]["cells"])
    cells["region"] = pd.Categorical(cells["region"], package.REGIONS, ordered=True)
    pd.testing.assert_frame_equal(recording.cells, cells.rename_axis("cell"), check_dtype=False, check_index_type=False)
    expected = file.to_pandas().set_index("t_s")
    pd.testing.assert_frame_equal(recording.to_pandas(), expected)
    np.testing.assert_allclose(recording.force_n, expected.to_numpy(float) @ cells["area_mm2"].to_numpy() / 1000, rtol=1e-6)
    data = recording.to_xarray()
    assert data["pressure_kpa"].dims == ("t_s", "cell") and data.attrs["side"] == recording.side
    heel = data["pressure_kpa"].sel(cell=data["region"] == "heel").to_numpy()
    np.testing.assert_array_equal(heel, expected.to_numpy()[:, (cells["region"] == "heel").to_numpy()])


def test_arrays_share_the_memory_of_the_recording_and_outlive_it(walk_file: pathlib.Path) -> None:
    recording = package.read(walk_file)
    pressure_kpa, again = recording.pressure_kpa, recording._core.pressure_kpa().to_numpy()
    assert np.shares_memory(pressure_kpa, again)
    assert not pressure_kpa.flags.writeable
    total = pressure_kpa.sum()
    del recording, again
    assert pressure_kpa.sum() == total > 0


def test_a_change_of_the_cells_does_not_change_forces(walk_file: pathlib.Path) -> None:
    recording = package.read(walk_file)
    areas_mm2 = package.read(walk_file).cells["area_mm2"]
    cells = recording.cells
    cells.loc[:, "area_mm2"] = 0.0
    pd.testing.assert_series_equal(recording.cells["area_mm2"], areas_mm2)
    np.testing.assert_array_equal(recording.force_n, package.read(walk_file).force_n)
    cells = recording.cells
    cells.loc[:, "area_mm2"] = 0.0
    np.testing.assert_array_equal(recording.force_n, package.read(walk_file).force_n)
    assert list(recording.cells.groupby("region", observed=True).size().index) == list(package.REGIONS)


def test_errors_name_the_file_and_the_remedy(tmp_path: pathlib.Path, walk_file: pathlib.Path) -> None:
    with pytest.raises(FileNotFoundError, match="nowhere.parquet: .*; check the path$"):
        package.read(tmp_path / "nowhere.parquet")
    damaged = tmp_path / "damaged.parquet"
    damaged.write_bytes(walk_file.read_bytes()[:-1000])
    with pytest.raises(ValueError, match="damaged.parquet: the file is cut off.*copy it again"):
        package.read(damaged)
    recording = package.read(walk_file)
    with pytest.raises(ValueError, match="from 20 to 52"):
        recording.replay(options=package.Options(size=53))
    with pytest.raises(TypeError, match="expected a plantar.Options, not {'size': 40}"):
        recording.replay(options={"size": 40})  # type: ignore[arg-type]
    with pytest.raises(ValueError, match="contact-off may not be above"):
        recording.replay(options=package.Options(contact_on_kpa=5, contact_off_kpa=6))
    with pytest.raises(ValueError, match="strike and release must be above 0"):
        recording.replay(options=package.Options(strike_n=0))
    with pytest.raises(ValueError, match='"adaptive" or "absolute"'):
        recording.replay(options=package.Options(thresholds="fixed"))  # type: ignore[arg-type]
    with pytest.raises(TypeError, match="min_stance_ms = 1.5: expected a whole number"):
        recording.replay(options=package.Options(min_stance_ms=1.5))  # type: ignore[arg-type]
    with pytest.raises(ValueError, match='"projection" or "paper"'):
        package.fit(recording, options=package.Options(method="other"))  # type: ignore[arg-type]
    for size, words in (("42", "size = '42'"), (42.5, "size = 42.5")):
        with pytest.raises(TypeError, match=f"{words}: expected a whole number"):
            recording.replay(options=package.Options(size=size))  # type: ignore[arg-type]
    with pytest.raises(TypeError, match="contact_on_kpa = '5': expected a number or None"):
        package.fit(recording, options=package.Options(contact_on_kpa="5"))  # type: ignore[arg-type]
    with pytest.raises(ValueError, match="2 recordings, but fit_steps fits one"):
        package.fit_steps([walk_file, walk_file])  # type: ignore[arg-type]


@pytest.mark.parametrize(
    "options",
    [
        package.Options(filter="smoothed"),
        package.Options(method="other"),  # type: ignore[arg-type]
        package.Options(bounds="paper"),
        package.Options(tissue="nowhere.toml"),
        package.Options(compression=0.3),
    ],
)
def test_options_without_effect_on_a_replay_are_refused(walk_file: pathlib.Path, options: package.Options) -> None:
    [name] = [name for name, value in vars(options).items() if value != getattr(package.Options, name)]
    with pytest.raises(ValueError, match=f"the option {name} has no effect on a replay"):
        package.replay(walk_file, options=options)


@pytest.mark.parametrize(
    ("column", "file_type", "remedy"), [("c0_kpa", pa.float64(), "float32"), ("t_s", pa.float32(), "float64")]
)
def test_the_remedy_for_another_type_of_a_column_is_a_cast(
    walk_file: pathlib.Path, tmp_path: pathlib.Path, column: str, file_type: pa.DataType, remedy: str
) -> None:
    table = pq.read_table(walk_file)
    index = table.column_names.index(column)
    path = tmp_path / "other.parquet"
    pq.write_table(table.set_column(index, column, table[column].cast(file_type)), path)
    with pytest.raises(ValueError, match=f"other.parquet: column {index + 1}: `{column}` .*; cast the column to {remedy}$"):
        package.read(path)


@pytest.mark.parametrize("compression", ["zstd", "gzip", "brotli"])
def test_a_compression_that_is_not_supported_is_named(
    walk_file: pathlib.Path, tmp_path: pathlib.Path, compression: str
) -> None:
    path = tmp_path / "other.parquet"
    pq.write_table(pq.read_table(walk_file), path, compression=compression)
    with pytest.raises(
        ValueError, match=f"compressed with {compression}, which is not supported; write it with snappy or without compression"
    ):
        package.read(path)
    pq.write_table(pq.read_table(walk_file), path, compression="none")
    assert package.read(path).side == package.read(walk_file).side


def test_the_lines_of_the_readme_write_a_recording(
    walk_file: pathlib.Path, tmp_path: pathlib.Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    text = (pathlib.Path(__file__).parents[1] / "README.md").read_text(encoding="utf-8")
    section = text.partition("\n## From NumPy\n")[2].partition("\n## ")[0]
    lines = [line[4:] for line in section.splitlines() if line.startswith("    ")]
    assert lines
    monkeypatch.chdir(tmp_path)
    recording = package.read(walk_file)
    names = {"plantar": package, "pressure_kpa": recording.pressure_kpa.astype(float), "cells": recording.cells}
    exec("\n".join(lines), names)
    own = package.read("own.parquet")
    np.testing.assert_array_equal(own.pressure_kpa, recording.pressure_kpa)
    np.testing.assert_allclose(own.t_s, recording.t_s, atol=1e-9)
    pd.testing.assert_frame_equal(own.cells, recording.cells)
    assert (own.side, own.rate_hz, own.source) == ("right", 100.0, "trial 1.")


def changed(source: pathlib.Path, path: pathlib.Path, pressure: float = 1.0, length: float = 1.0) -> pathlib.Path:
    """A copy of a recording with pressures and lengths multiplied by these factors, and areas by the square of the second."""
    table = pq.read_table(source)
    meta = json.loads(table.schema.metadata[b"plantar"])
    for cell in meta["layout"]["cells"]:
        cell.update(x_mm=cell["x_mm"] * length, y_mm=cell["y_mm"] * length, area_mm2=cell["area_mm2"] * length**2)
    columns = [column.to_numpy() * np.float32(pressure) for column in table.columns[1:]]
    table = pa.table([table.column(0), *columns], schema=table.schema)
    pq.write_table(table.replace_schema_metadata({"plantar": json.dumps(meta)}), path)
    return path


@pytest.mark.parametrize(
    ("pressure", "length", "words"),
    [
        (10.0, 1.0, r"The largest force on the right foot is 80\d\d N, more than a foot carries"),
        (7.5, 1.0, r"The largest force on the right foot is 60\d\d N, .* check the unit of the pressures"),
        (1.0, 0.1, r"The cells of the right foot extend over 2\d.\d mm, and have 190 mm2 in total"),
    ],
)
def test_values_in_another_unit_are_named_when_a_recording_is_read(
    walk_file: pathlib.Path, tmp_path: pathlib.Path, pressure: float, length: float, words: str
) -> None:
    path = changed(walk_file, tmp_path / "other.parquet", pressure, length)
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        package.read(path)
        package.replay(path)
        package.fit_steps(path)
        package.fit([path])
    texts = [str(warning.message) for warning in caught if re.search(f"other.parquet: {words}", str(warning.message))]
    assert len(texts) == 4
    assert all(warning.filename == __file__ for warning in caught)


def test_a_recording_with_usual_or_small_forces_is_read_without_a_warning(
    walk_file: pathlib.Path, tmp_path: pathlib.Path
) -> None:
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        package.read(walk_file)
        package.read(changed(walk_file, tmp_path / "lifted.parquet", 1e-3))


def test_exchanged_axes_are_named_when_a_recording_is_read(walk_file: pathlib.Path, tmp_path: pathlib.Path) -> None:
    table = pq.read_table(walk_file)
    meta = json.loads(table.schema.metadata[b"plantar"])
    for cell in meta["layout"]["cells"]:
        cell["x_mm"], cell["y_mm"] = cell["y_mm"], cell["x_mm"]
    path = tmp_path / "exchanged.parquet"
    pq.write_table(table.replace_schema_metadata({"plantar": json.dumps(meta)}), path)
    with pytest.warns(UserWarning, match=r"exchanged.parquet: The layout of the right foot is wider \(2\d\d mm\) than long"):
        package.read(path)


def test_the_home_folder_is_inserted_for_a_tilde_in_a_text(
    walk_file: pathlib.Path, tmp_path: pathlib.Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("HOME", str(tmp_path))
    monkeypatch.setenv("USERPROFILE", str(tmp_path))
    (tmp_path / "walk.parquet").write_bytes(walk_file.read_bytes())
    assert package.read("~/walk.parquet").path == str(tmp_path / "walk.parquet")
    (tmp_path / "tissue.toml").write_text("heel = 17\n")
    fit = package.fit("~/walk.parquet", options=package.Options(size=40, tissue="~/tissue.toml"))
    assert fit.table().loc["heel", "d0_mm"] == 17
    fit.write("~/params.toml")
    fit.report("~/report.html")
    assert (tmp_path / "report.html").exists()
    assert not package.replay("~/walk.parquet", params="~/params.toml").steps.empty
    with pytest.raises(FileNotFoundError, match=f"{re.escape(str(tmp_path))}.nowhere.toml"):
        package.replay("~/walk.parquet", options=package.Options(zero="~/nowhere.toml"))


def test_a_path_as_bytes_is_refused(walk_file: pathlib.Path) -> None:
    path: Any = os.fsencode(walk_file)
    calls: list[Callable[[Any], object]] = [package.read, package.replay, package.fit, package.fit_steps]
    for call in calls:
        with pytest.raises(TypeError, match="walk.parquet'?: expected a path as text or as a pathlib.Path, not as bytes"):
            call(path)
    with pytest.raises(TypeError, match="not as bytes"):
        package.Options(zero=path)


def test_a_recorded_live_stream_is_refused_with_the_command_that_fits_it(tmp_path: pathlib.Path) -> None:
    session, stream = tmp_path / "session", tmp_path / "walk.plantar"
    (session / "steps").mkdir(parents=True)
    stream.write_bytes(b"stream")
    with pytest.raises(ValueError, match="session: a folder of `plantar record` .*: `plantar fit .*session` fits .*--cells"):
        package.fit(session)
    (session / "cells" / "000").mkdir(parents=True)
    with pytest.raises(ValueError, match="fits it; Python reads the recordings .* are the folders in .*cells"):
        package.read(session)
    with pytest.raises(ValueError, match="walk.plantar: a recorded live stream: `plantar fit .*walk.plantar` fits it"):
        package.replay(stream)


@pytest.mark.filterwarnings("ignore::UserWarning")
def test_a_replay_is_described_in_one_line(walk_file: pathlib.Path, tmp_path: pathlib.Path) -> None:
    replay = package.replay(walk_file, precision="f64")
    assert repr(replay) == f"<Replay of {walk_file}: right foot, 6 steps, typical parameters of size 42, f64>"
    params = tmp_path / "params.toml"
    package.fit(walk_file).write(params)
    replay = package.replay(walk_file, params=params)
    assert repr(replay) == f"<Replay of {walk_file}: right foot, 6 steps, {params}, f32>"


def test_cut_off_contacts_are_those_of_the_command_line(walk_file: pathlib.Path, tmp_path: pathlib.Path) -> None:
    table = pq.read_table(walk_file)
    force_n = package.read(walk_file).force_n
    is_loaded = force_n > 0.5 * force_n.max()
    first, last = np.flatnonzero(is_loaded)[[0, -1]]
    path = tmp_path / "cut.parquet"
    pq.write_table(table.slice(first, last - first + 1), path)
    expected = [line for line in plantar("replay", path).splitlines() if line.startswith("left out: ")]
    assert len(expected) == 2
    with pytest.warns(UserWarning) as caught:
        package.replay(path)
    found = [str(warning.message) for warning in caught if "left out" in str(warning.message)]
    assert found == [
        line.replace(f"left out: {path} at ", f"{path}: left out: the contact at ") for line in expected
    ]
    assert all(warning.filename == __file__ for warning in caught)


@pytest.mark.filterwarnings("ignore:parameters .* are not personal")
def test_a_masked_cell_is_a_warning(walk_file: pathlib.Path, tmp_path: pathlib.Path) -> None:
    table = pq.read_table(walk_file)
    cells = package.read(walk_file).cells
    # A cell that reads the same high pressure in every frame.
    cell = int(np.flatnonzero(cells["region"] == "heel")[3])
    name = f"c{cell}_kpa"
    stuck = pa.array(np.full(len(table), 900.0, np.float32))
    path = tmp_path / "stuck.parquet"
    pq.write_table(table.set_column(cell + 1, table.schema.field(name), stuck), path)
    printed = plantar("replay", path)
    assert f"sensor fault: cell {cell} stuck" in printed and "1 of 240 cells masked: Heel 1" in printed, printed
    with pytest.warns(UserWarning, match=f"stuck.parquet: sensor faults: cell {cell} stuck; masked cells: heel 1$"):
        package.replay(path)


@pytest.mark.filterwarnings("ignore:parameters .* are not personal")
def test_replayed_steps_are_those_of_the_command_line(walk_file: pathlib.Path, tmp_path: pathlib.Path) -> None:
    plantar("replay", walk_file, "--json", tmp_path / "steps.json", "--frames", tmp_path / "frames.parquet")
    replay = package.replay(walk_file)
    steps = json.loads((tmp_path / "steps.json").read_text())
    assert list(replay.steps.index.unique("step")) == [step["step"] for step in steps]
    assert len(replay.steps) == 8 * len(steps) == 48
    for step in steps:
        for region, expected in step["regions"].items():
            row = replay.steps.loc[(step["step"], region)]
            assert row["start_s"] == pytest.approx(replay.recording.t_s[0] + step["start_s"], abs=1e-9)
            assert row["duration_s"] == step["duration_s"]
            assert row["foot_force_peak_n"] == step["foot"]["foot_force_peak_n"]
            for name in ("measured_force_peak_n", "area_peak_mm2", "model_force_peak_n", "peak_pressure_kpa", "clamped"):
                assert row[name] == expected[name], (step["step"], region, name)
            assert row["ellipse_x_mm"] == expected["ellipse_at_peak"]["x_mm"]
    frames = pq.read_table(tmp_path / "frames.parquet").to_pandas().set_index("t_s")
    pd.testing.assert_frame_equal(replay.frames, frames)
    double = package.replay(walk_file, precision="f64").frames
    assert not double.equals(frames)
    np.testing.assert_allclose(double["total_force_n"], frames["total_force_n"], rtol=1e-5, atol=1e-3)


@pytest.mark.filterwarnings("ignore:parameters .* are not personal")
def test_steps_begin_and_end_at_the_stated_thresholds(walk_file: pathlib.Path) -> None:
    options = package.Options(thresholds="absolute", strike_n=300, release_n=250)
    replay = package.replay(walk_file, options=options)
    force_n, t_s = replay.recording.force_n, replay.recording.t_s
    steps = replay.steps.groupby(level="step")[["start_s", "duration_s"]].first()
    assert len(steps) == 6
    for start_s, duration_s in steps.itertuples(index=False):
        strike, off = (int(np.abs(t_s - time_s).argmin()) for time_s in (start_s, start_s + duration_s))
        assert force_n[strike - 1] < 300 <= force_n[strike]
        assert force_n[off] < 250 <= force_n[off - 1]


def test_typical_parameters_are_reported_and_personal_ones_are_not(
    walk_file: pathlib.Path, tmp_path: pathlib.Path, recwarn: pytest.WarningsRecorder
) -> None:
    package.replay(walk_file)
    package.read(walk_file).replay()
    for words in ("not personal", "NOT APPLICABLE to toe_2 ") * 2:
        warning = recwarn.list.pop(0)
        assert words in str(warning.message) and warning.filename == __file__
    package.fit(walk_file, options=package.Options(size=42)).write(tmp_path / "params.toml")
    package.replay(walk_file, params=tmp_path / "params.toml")
    assert not recwarn.list
    text = (tmp_path / "params.toml").read_text()
    (tmp_path / "partly.toml").write_text(text.replace('"toe_2", ', ""))
    package.replay(walk_file, params=tmp_path / "partly.toml")
    assert "parameters of toe_2 are typical values" in str(recwarn.list.pop(0).message)


@pytest.mark.parametrize(("scale", "size"), [(1.0, 42), (0.5, 42), (2.0, 42), (1.0, 52), (1.0, 20)])
def test_typical_parameters_that_do_not_apply_are_named_as_on_the_command_line(
    tmp_path: pathlib.Path, scale: float, size: int
) -> None:
    path = walk(tmp_path / "walk.parquet", "--steps", 4, scale=scale)
    typical, partly = tmp_path / "typical.toml", tmp_path / "partly.toml"
    plantar("params", "typical", "--size", size, "--out", typical)
    package.fit(path).write(partly)
    partly.write_text(partly.read_text().replace('"toe_2", ', ""))
    counts = []
    named = re.compile(r"\w+ \(\d+ mm2, \d+ kPa\)")
    for options, keywords in (
        (["--size", size], {"options": package.Options(size=size)}),
        (["--params", typical], {"params": typical}),
        (["--params", partly], {"params": partly}),
    ):
        printed = plantar("replay", path, *options)
        expected = [named.findall(line) for line in printed.splitlines() if "NOT APPLICABLE" in line]
        with warnings.catch_warnings(record=True) as caught:
            warnings.simplefilter("always")
            package.replay(path, **keywords)
        texts = [str(warning.message) for warning in caught if "NOT APPLICABLE" in str(warning.message)]
        assert [named.findall(text) for text in texts] == expected
        assert all(warning.filename == __file__ for warning in caught)
        counts.append(sum(map(len, expected)))
    # Personal parameters apply.
    assert counts[2] <= 1
    assert counts[0] > 0 or (scale == 1.0 and size >= 42)


@pytest.mark.filterwarnings("ignore:parameters .* are not personal")
def test_the_peaks_of_the_cells_are_those_of_the_regions_of_each_step(walk_file: pathlib.Path) -> None:
    replay = package.replay(walk_file)
    peaks = replay.cell_peaks_kpa
    regions = replay.recording.cells["region"]
    by_step = peaks.T.groupby(regions, observed=True).max().T
    expected = replay.steps["peak_pressure_kpa"].unstack()
    # The baseline of the computed walk is 0, so the recorded pressures are those that the insole evaluates. A step record has a
    # resolution of 0.1 kPa.
    np.testing.assert_allclose(by_step.to_numpy(), expected.to_numpy(), atol=0.1)
    # There is no load between the steps of the computed walk.
    pressure_kpa, t_s = replay.recording.pressure_kpa, replay.recording.t_s
    start_s = replay.steps.xs("heel", level="region")["start_s"]
    assert (peaks.loc[1] == pressure_kpa[(t_s >= start_s[1]) & (t_s < start_s[2])].max(axis=0)).all()


def test_a_recording_without_a_step_has_no_peaks(tmp_path: pathlib.Path) -> None:
    recording = package.read(walk(tmp_path / "walk.parquet", "--steps", 2))
    with pytest.warns(UserWarning, match="no step|no complete step|not one step"):
        replay = recording.part(to_s=0.1).replay()
    assert replay.cell_peaks_kpa.shape == (0, len(recording.cells))


def test_normalised_steps_are_interpolated_from_heel_strike_to_toe_off(
    walk_file: pathlib.Path, tmp_path: pathlib.Path
) -> None:
    plantar("replay", walk_file, "--json", tmp_path / "steps.json", "--frames", tmp_path / "frames.parquet")
    frames = pq.read_table(tmp_path / "frames.parquet").to_pandas()
    replay = package.replay(walk_file)
    for quantity, region in (("total_force_n", None), ("area_mm2", "heel")):
        curves = replay.normalised(quantity, region=region)
        assert curves.shape == (6, 101)
        column = frames[quantity if region is None else f"{region}_{quantity}"]
        for curve, step in zip(curves, json.loads((tmp_path / "steps.json").read_text()), strict=True):
            last_s = step["duration_s"] - 1 / replay.recording.rate_hz
            sample_t_s = frames["t_s"][0] + step["start_s"] + np.arange(101) / 100 * last_s
            np.testing.assert_allclose(curve, np.interp(sample_t_s, frames["t_s"], column), rtol=1e-12, atol=1e-9)
            if region is None:
                # The step begins and ends near the threshold of stance, and its peak is that of the step record.
                assert curve[0] < 0.2 * curve.max() and curve[-1] < 0.2 * curve.max()
                assert curve.max() == pytest.approx(step["foot"]["foot_force_peak_n"], rel=0.02)
    assert replay.normalised("total_force_n", 11).shape == (6, 11)
    with pytest.raises(ValueError, match="heel_area_mm2"):
        replay.normalised("area", region="heel")
    with pytest.raises(ValueError, match="no region foo: the regions are heel, .*, toes_35"):
        replay.normalised("area_mm2", region="foo")


@pytest.mark.filterwarnings("ignore:parameters .* are not personal")
def test_a_percentage_of_stance_is_the_same_in_steps_and_normalised_curves(walk_file: pathlib.Path) -> None:
    replay = package.replay(walk_file)
    steps = replay.steps.groupby(level="step").first()
    for axis in ("x", "y"):
        curves = replay.normalised(f"cop_{axis}_mm")
        for percent in (10, 30, 50, 70, 90):
            # The step record has a resolution of 0.1 mm. One frame later, the centre of pressure has moved by 3 mm at 50 %.
            np.testing.assert_allclose(curves[:, percent], steps[f"gait_{axis}_{percent}_mm"], atol=0.06)


@pytest.mark.filterwarnings("ignore:parameters .* are not personal")
def test_normalised_values_exist_only_during_the_contact_of_a_region(walk_file: pathlib.Path) -> None:
    replay = package.replay(walk_file)
    curves = replay.normalised("cop_y_mm", region="heel")
    is_common = np.asarray(np.isfinite(curves).all(axis=0))
    # The heel is loaded in the first part of the stance.
    assert is_common[5:30].all() and not is_common[90:].any()
    area_mm2 = replay.normalised("area_mm2", region="heel")
    assert not np.isnan(area_mm2).any() and (area_mm2[:, is_common] > 0).all()


@pytest.mark.filterwarnings("ignore:parameters .* are not personal")
def test_a_column_can_be_added_to_the_frames_without_a_warning(walk_file: pathlib.Path) -> None:
    frames = package.replay(walk_file).frames
    # pandas issues a PerformanceWarning above 100 arrays.
    assert len(frames.columns) > 100
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        assert frames.reset_index().columns[0] == "t_s"
        assert frames.assign(half_n=frames["total_force_n"] / 2)["half_n"].max() > 0


@pytest.mark.filterwarnings("ignore:parameters .* are not personal")
def test_steps_have_the_time_axis_of_the_recording(tmp_path: pathlib.Path) -> None:
    path = walk(tmp_path / "walk.parquet", "--rate", 300, "--steps", 20)
    first = package.replay(path)
    table = pq.read_table(path)
    field = table.schema.field("t_s")
    pq.write_table(table.set_column(0, field, pc.add(table["t_s"], 1000.0)), path)
    later = package.replay(path)
    for replay, start_s in ((first, 0.0), (later, 1000.0)):
        starts_s = replay.steps["start_s"].groupby(level="step").first()
        assert starts_s.between(start_s, start_s + 60).all() and starts_s.isin(replay.frames.index).all()
        fitted = package.fit_steps(replay.recording).to_pandas().groupby("step")["start_s"].first()
        assert starts_s.to_dict() == fitted.to_dict()
        # In the frame of heel strike, unlike in the one before, the foot is loaded.
        assert (replay.frames.loc[starts_s, "total_force_n"] > 10).all()
    np.testing.assert_array_equal(later.normalised("total_force_n"), first.normalised("total_force_n"))


@pytest.mark.filterwarnings("ignore:parameters .* are not personal")
def test_regions_are_sorted_from_heel_to_toes(walk_file: pathlib.Path) -> None:
    steps = package.replay(walk_file).steps
    assert list(steps["peak_pressure_kpa"].unstack().columns) == list(package.REGIONS)
    assert list(steps["peak_pressure_kpa"].groupby("region", observed=True).mean().index) == list(package.REGIONS)
    assert steps.xs("hallux", level="region").shape[0] == 6


@pytest.mark.filterwarnings("ignore:parameters .* are not personal")
def test_normalised_steps_do_not_drift_at_a_rate_with_a_fractional_period_in_us(tmp_path: pathlib.Path) -> None:
    path = walk(tmp_path / "walk.parquet", "--rate", 300, "--steps", 60)
    curves = package.replay(path).normalised("total_force_n")
    # The steps of the computed walk differ by a few percent, and each begins at another time between two frames. The force
    # grows by up to 30 N from one frame to the next.
    assert len(curves) == 60
    assert np.abs(curves[-1] - curves[0]).max() < 40.0


@pytest.mark.filterwarnings("ignore:parameters .* are not personal")
@pytest.mark.parametrize("rate_hz", [128, 300])
def test_the_frame_period_is_that_of_the_insole(tmp_path: pathlib.Path, rate_hz: int) -> None:
    replay = package.replay(walk(tmp_path / "walk.parquet", "--rate", rate_hz, "--steps", 20))
    # The insole counts its frames, so each of its times is a whole number of periods.
    frames = replay.steps["duration_s"].to_numpy() / replay._period_s
    assert np.abs(frames - frames.round()).max() < 1e-3


@pytest.mark.filterwarnings("ignore:parameters .* are not personal")
def test_a_recording_without_steps_has_tables_without_rows(walk_file: pathlib.Path, tmp_path: pathlib.Path) -> None:
    table = pq.read_table(walk_file)
    pq.write_table(table.slice(0, 20), tmp_path / "short.parquet")
    with pytest.warns(UserWarning, match=r"short.parquet: no step: the largest total force is \d+\.\d N; check .* in kPa"):
        replay = package.replay(tmp_path / "short.parquet")
    assert replay.normalised("total_force_n").shape == (0, 101)
    pd.testing.assert_frame_equal(replay.steps, package.replay(walk_file).steps.iloc[:0])
    rows = package.fit_steps(tmp_path / "short.parquet")
    assert rows.num_rows == 0 and "secant_modulus_kpa" in rows.column_names
    with pytest.raises(ValueError, match="no region could be fitted"):
        package.fit(tmp_path / "short.parquet").write(tmp_path / "params.toml")
    assert not (tmp_path / "params.toml").exists()


def test_a_replay_in_another_unit_has_no_step_and_a_warning(tmp_path: pathlib.Path) -> None:
    # Pressures in MPa.
    path = walk(tmp_path / "walk.parquet", "--steps", 2, scale=1e-3)
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        assert package.replay(path).steps.empty and package.read(path).replay().steps.empty
    texts = [str(warning.message) for warning in caught if "no step" in str(warning.message)]
    assert len(texts) == 2 and "largest total force is 1.2" in texts[0] and "release_n" in texts[0]
    assert all(warning.filename == __file__ for warning in caught)


def test_parameters_for_another_filter_are_used_with_a_warning(walk_file: pathlib.Path, tmp_path: pathlib.Path) -> None:
    filters: list[tuple[Literal["live", "smoothed"], str]] = [("smoothed", "smoothing"), ("live", "filter of the live stream")]
    for name, words in filters:
        path = tmp_path / f"{name}.toml"
        package.fit(walk_file, options=package.Options(filter=name)).write(path)
        with pytest.warns(UserWarning, match=words):
            package.replay(walk_file, params=path)


def test_parameters_of_the_other_foot_are_used_with_a_warning(walk_file: pathlib.Path, tmp_path: pathlib.Path) -> None:
    left = walk(tmp_path / "left.parquet", "--side", "left", "--steps", 6, scale=1.05)
    params = tmp_path / "params.toml"
    package.fit(walk_file).write(params)
    with pytest.warns(UserWarning, match="from the right foot, but the recording is of the left foot"):
        package.replay(left, params=params)
    package.fit([walk_file, left]).write(params)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        package.replay(left, params=params)


def test_the_help_of_the_options_has_their_meanings() -> None:
    text = package.Options.__doc__ or ""
    for field in dataclasses.fields(package.Options):
        assert f"\n    ``{field.name}``: " in text


def test_other_threads_continue_while_a_recording_is_fitted(walk_file: pathlib.Path) -> None:
    recording = package.read(walk_file)
    has_begun, is_done = threading.Event(), []

    def evaluate() -> None:
        has_begun.set()
        package.fit(recording)
        is_done.append(True)

    interval_s = sys.getswitchinterval()
    # Another thread now runs only when the running thread releases the global interpreter lock itself.
    sys.setswitchinterval(1000)
    try:
        thread = threading.Thread(target=evaluate)
        thread.start()
        has_begun.wait()
        was_done = bool(is_done)
    finally:
        sys.setswitchinterval(interval_s)
    thread.join()
    assert is_done and not was_done


def test_a_recording_from_numpy_equals_that_of_its_file(tmp_path: pathlib.Path, walk_file: pathlib.Path) -> None:
    original = package.read(walk_file)
    copy = package.Recording.from_numpy(
        original.pressure_kpa.astype(float), original.cells, side=original.side, rate_hz=original.rate_hz, name="copy", sensor="s"
    )
    copy.write(tmp_path / "copy.parquet")
    for recording in (copy, package.read(tmp_path / "copy.parquet")):
        np.testing.assert_array_equal(recording.pressure_kpa, original.pressure_kpa)
        np.testing.assert_allclose(recording.t_s, original.t_s, atol=1e-9)
        pd.testing.assert_frame_equal(recording.cells, original.cells)
        pd.testing.assert_frame_equal(recording.replay().steps, original.replay().steps)
    assert copy.source == "copy." and copy.path == "copy"
    # Without regions, the template assigns them, as the import of a recording without regions does.
    places = original.cells.drop(columns="region")
    bare = package.Recording.from_numpy(
        original.pressure_kpa, places, side="left", rate_hz=100, name="bare", sensor="s", t_s=original.t_s
    )
    assert list(bare.cells["region"].cat.categories) == list(package.REGIONS) and bare.side == "left"
    assert (bare.cells["region"] == original.cells["region"]).mean() > 0.8


def test_arrays_that_are_no_recording_are_refused_with_the_place(walk_file: pathlib.Path) -> None:
    original = package.read(walk_file)
    pressure_kpa, cells = original.pressure_kpa.copy(), original.cells

    def made(**changed: Any) -> package.Recording:
        fields: dict[str, Any] = {"side": "right", "rate_hz": 100.0, "name": "own", "sensor": "s"} | changed
        values = fields.pop("pressure_kpa", pressure_kpa)
        return package.Recording.from_numpy(values, fields.pop("cells", cells), **fields)

    with pytest.raises(ValueError, match=r"own: pressure_kpa has the shape .*one column for each of the \d+ cells"):
        made(pressure_kpa=pressure_kpa[:, 1:])
    with pytest.raises(ValueError, match="own: cells has no column area_mm2"):
        made(cells=cells.drop(columns="area_mm2"))
    with pytest.raises(ValueError, match="own: t_s has the shape"):
        made(t_s=[0.0, 0.01])
    with pytest.raises(ValueError, match='side = "both": expected "left" or "right"'):
        made(side="both")
    with pytest.raises(ValueError, match='region = "toe": expected "heel" or '):
        made(cells=cells.assign(region="toe"))
    with pytest.raises(ValueError, match="own: cells: a cell has no region"):
        made(cells=cells.assign(region=cells["region"].where(cells.index > 0)))
    with pytest.raises(ValueError, match="own: frame 3: "):
        made(t_s=np.where(np.arange(len(pressure_kpa)) == 3, 1e3, original.t_s))
    pressure_kpa[5, 7] = np.nan
    with pytest.raises(ValueError, match="own: frame 5, cell 7: pressure NaN kPa; pressures must be finite"):
        made()


def test_a_part_of_a_recording_has_the_steps_in_it(walk_file: pathlib.Path) -> None:
    whole = package.read(walk_file)
    steps = whole.replay().steps.groupby("step")[["start_s", "duration_s"]].first()
    # From the swing before the third step to the swing after the fourth one.
    from_s, to_s = steps["start_s"].iloc[2] - 0.2, steps["start_s"].iloc[4] - 0.1
    part = whole.part(from_s, to_s)
    assert part.t_s[0] >= from_s and part.t_s[-1] <= to_s and len(part.t_s) == ((whole.t_s >= from_s) & (whole.t_s <= to_s)).sum()
    of_part = part.replay().steps.groupby("step")[["start_s", "duration_s"]].first()
    np.testing.assert_allclose(of_part.to_numpy(), steps.iloc[2:4].to_numpy(), atol=1e-9)
    assert part.source.startswith(whole.source) and "only the frames from" in part.source
    assert whole.part().source == whole.source
    with pytest.raises(ValueError, match=r"no frame from 1000 s; the frames are from 0 to "):
        whole.part(1000)
    with pytest.raises(ValueError, match="the part does not end after it begins"):
        whole.part(float("nan"))


def test_pressures_at_a_limit_and_values_at_the_end_of_their_range_are_named(
    walk_file: pathlib.Path, tmp_path: pathlib.Path
) -> None:
    whole = package.read(walk_file)

    def recorded(pressure_kpa: Any) -> package.Recording:
        return package.Recording.from_numpy(
            pressure_kpa, whole.cells, side="right", rate_hz=whole.rate_hz, name="own", sensor="s"
        )

    with pytest.warns(UserWarning, match="own: In .* frames, several cells have exactly the largest pressure, 150 kPa"):
        limited = recorded(np.minimum(whole.pressure_kpa, 150))
    limited.write(tmp_path / "limited.parquet")
    assert "warning: In " in plantar("info", tmp_path / "limited.parquet")
    assert "warning: In " not in plantar("info", walk_file)
    # Steps in which the force on all cells begins from one frame to the next.
    steps = np.repeat(whole.pressure_kpa.max(axis=0)[None] * 4, 200, axis=0)
    steps[np.arange(200) % 100 < 50] = 0
    with pytest.warns(UserWarning, match=r"largest force"):
        sudden = recorded(steps)
    with pytest.warns(UserWarning, match=r"at the end of their range, .*loading_rate_n_s \(65535 N/s in \d steps?\)"):
        sudden.replay()


def test_load_bouts_are_those_of_the_command_line(tmp_path: pathlib.Path, walk_file: pathlib.Path) -> None:
    plantar("replay", walk_file, "--bouts", tmp_path / "bouts.json")
    expected = json.loads((tmp_path / "bouts.json").read_text())
    bouts = package.replay(walk_file).bouts
    assert list(bouts.index.unique("number")) == [bout["number"] for bout in expected] and expected
    for bout in expected:
        of_bout = bouts.loc[bout["number"]]
        assert (of_bout["kind"] == bout["kind"]).all()
        np.testing.assert_allclose(of_bout["start_s"], bout["start_s"], atol=1e-6)
        for region, values in bout["regions"].items():
            assert of_bout.loc[region, "measured_force_integral_n_s"] == pytest.approx(values["measured_force_integral_n_s"])
