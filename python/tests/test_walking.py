"""Measures of gait, compared with the command line, and with the steps of a replay."""

import json
import pathlib
from typing import Any

import numpy as np
import numpy.typing as npt
import pandas as pd
import pytest
from conftest import plantar, walk

import plantar as package


@pytest.fixture(scope="module")
def feet(tmp_path_factory: pytest.TempPathFactory) -> list[pathlib.Path]:
    """A walk of 24 steps of each foot."""
    folder = tmp_path_factory.mktemp("feet")
    return [walk(folder / f"{side}.parquet", "--steps", 24, "--side", side) for side in ("left", "right")]


def test_the_measures_are_those_of_the_command_line(tmp_path: pathlib.Path, feet: list[pathlib.Path]) -> None:
    plantar("gait", *feet, "--stride-length", 1.4, "--json", tmp_path / "gait.json", "--strides", tmp_path / "strides.csv")
    expected = json.loads((tmp_path / "gait.json").read_text())
    gait = package.gait(feet)
    assert gait.speed_m_s(stride_length_m=1.4) == pytest.approx(expected.pop("speed_m_s"))
    assert gait.results | {"speed_m_s": None} == expected | {"speed_m_s": None}
    strides = pd.read_csv(tmp_path / "strides.csv").set_index(["side", "start_s"])
    pd.testing.assert_frame_equal(gait.strides, strides, check_dtype=False)
    table = gait.table()
    for measure in expected["measures"]:
        for side in ("left", "right"):
            row, values = table.loc[(measure["key"], side)], gait.strides.loc[side][measure["key"]].dropna()
            assert row["mean"] == pytest.approx(values.mean()) and row["sd"] == pytest.approx(values.std(), abs=1e-9)
            assert row["count"] == len(values) == measure[side]["count"]
    assert table.loc[("cadence_per_min", "both"), "mean"] == expected["cadence_per_min"]["mean"]


def test_stride_times_are_the_differences_of_the_heel_strikes(feet: list[pathlib.Path]) -> None:
    starts_s = package.replay(feet[1]).steps.groupby("step")["start_s"].first()
    gait = package.gait(feet[1])
    np.testing.assert_allclose(gait.strides["stride_time_s"].to_numpy(float), np.diff(starts_s), atol=2e-6)
    np.testing.assert_allclose(gait.strides.loc["right"].index.to_numpy(float), starts_s[:-1], atol=2e-6)
    # Without the other foot, there is neither double support nor symmetry.
    assert set(gait.table().index.unique("of")) == {"right", "both"}
    assert np.isnan(gait.speed_m_s(distance_m=20)) and gait.strides["double_support_s"].isna().all()


def test_recordings_of_the_same_foot_and_options_without_effect_are_refused(feet: list[pathlib.Path]) -> None:
    with pytest.raises(ValueError, match="a second recording of the left foot: give one for each foot"):
        package.gait([feet[0], feet[0]])
    with pytest.raises(ValueError, match="the option contact_on_kpa has no effect on the measures of gait: leave it out"):
        package.gait(feet, options=package.Options(contact_on_kpa=5))
    with pytest.raises(TypeError, match="either stride_length_m or distance_m"):
        package.gait(feet).speed_m_s()
    with pytest.raises(ValueError, match="expected a length in metres, above 0"):
        package.gait(feet).speed_m_s(distance_m=-1)
    with pytest.raises(ValueError, match="no recording"):
        package.gait([])


def recorded(original: package.Recording, pressure_kpa: npt.NDArray[np.float32], name: str, **changed: Any) -> package.Recording:
    """A recording with the cells of another one."""
    fields: dict[str, Any] = {"side": original.side, "rate_hz": original.rate_hz, "sensor": "s"} | changed
    return package.Recording.from_numpy(pressure_kpa, original.cells, name=name, **fields)


def test_recordings_that_cannot_be_compared_are_refused_or_noted(feet: list[pathlib.Path]) -> None:
    left, right = (package.read(path) for path in feet)
    slow = recorded(right, right.pressure_kpa, "slow", rate_hz=50.0)
    with pytest.raises(ValueError, match=r"different rates \(100.00 and 50.00 Hz\)"):
        package.gait([left, slow])
    own = recorded(right, right.pressure_kpa, "own", sensor="insole 0x1a, 240 cells")
    with pytest.warns(UserWarning, match="the feet are not compared"):
        gait = package.gait([left, own])
    assert gait.strides["double_support_s"].isna().all() and not gait.results["has_both_feet"]


def test_a_foot_without_a_step_is_named(feet: list[pathlib.Path]) -> None:
    left, right = (package.read(path) for path in feet)
    still = recorded(right, np.full_like(right.pressure_kpa, 0.1), left.source)
    with pytest.warns(UserWarning, match="no step: the largest total force is"):
        gait = package.gait([left, still])
    assert ("cadence_per_min", "both") not in gait.table().index and np.isnan(gait.speed_m_s(stride_length_m=1.4))
    with pytest.raises(ValueError, match="^no steps: .*no step: the largest total force is"):
        package.gait(still)


def test_recordings_of_different_walks_are_noted(feet: list[pathlib.Path]) -> None:
    left = package.read(feet[0])
    other = recorded(left, left.pressure_kpa, "another day", t_s=left.t_s)
    with pytest.warns(UserWarning, match="different origins"):
        package.gait([other, feet[1]])


def test_the_zero_is_subtracted(tmp_path: pathlib.Path, feet: list[pathlib.Path]) -> None:
    """With a constant reading of each cell, and a zero file of it, the measures are those without both."""
    right = package.read(feet[1])
    offset_kpa = 12.0
    still = np.full_like(right.pressure_kpa[:2000], offset_kpa)
    # A standing trial: 5 s seated, 10 s of standing, 5 s seated.
    still[500:1500] += 40.0
    recorded(right, still, "standing").write(tmp_path / "standing.parquet")
    plantar("zero", tmp_path / "standing.parquet", "--out", tmp_path / "zero.toml")
    shifted = recorded(right, right.pressure_kpa + np.float32(offset_kpa), "walk")
    expected, result = package.gait(right), package.gait(shifted, options=package.Options(zero=tmp_path / "zero.toml"))
    peaks_n = [gait.table().loc[("peak_force_n", "right"), "mean"] for gait in (expected, result)]
    assert peaks_n[0] == pytest.approx(peaks_n[1], rel=0.01)
    assert len(result.strides) == len(expected.strides)
