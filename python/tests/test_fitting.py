"""Fits and repeatability, compared with the command line and with closed forms."""

import json
import pathlib
import tomllib

import numpy as np
import pandas as pd
import pytest
from conftest import plantar, walk

import plantar as package
from plantar import fitting


def test_a_fit_is_that_of_the_command_line(walk_file: pathlib.Path, tmp_path: pathlib.Path) -> None:
    options = ["--size", 40, "--contact-full", 0]
    files = ["--out", tmp_path / "params.toml", "--json", tmp_path / "fit.json"]
    plantar("fit", walk_file, *options, *files)
    expected = json.loads((tmp_path / "fit.json").read_text())
    fit = package.fit(walk_file, options=package.Options(size=40, contact_full_kpa=0))
    table = fit.table()
    assert list(table.index) == list(package.REGIONS) and table["fitted"].sum() >= 5
    for region, result in expected["regions"].items():
        row = table.loc[region]
        assert row["fitted"] == result["fitted"]
        if not result["fitted"]:
            assert row["reason"] == result["reason"]
            continue
        for name, value in {**result["ellipsoid"], "stiffness_pa": result["identified"]["stiffness_pa"]}.items():
            assert row[name] == pytest.approx(value, rel=1e-12), (region, name)
        assert row["n_low"] <= row["n"] <= row["n_high"]
        # The eight parameters result in the same force as the five: K = k C^(n+1) / d0^n.
        stiffness_pa = row["k_n_m3"] * (row["c_mm"] * 1e-3) ** (row["n"] + 1) / (row["d0_mm"] * 1e-3) ** row["n"]
        assert stiffness_pa == pytest.approx(row["stiffness_pa"], rel=1e-9)
    fit.write(tmp_path / "own.toml")
    own, other = (tomllib.loads((tmp_path / name).read_text()) for name in ("own.toml", "params.toml"))
    assert own == other
    fit.report(tmp_path / "report.html")
    assert "<svg" in (tmp_path / "report.html").read_text()


def test_an_infinite_end_of_an_interval_is_the_widest() -> None:
    # JSON has null for an infinite number.
    assert fitting._widest([1.0, None], [0.0, 2.0]) == (1.0, float("inf"))
    assert fitting._widest([0.5, 1.0], [None, 2.0]) == (float("-inf"), 2.0)
    assert fitting._widest(None, [1.0, 2.0]) == (1.0, 2.0)
    assert np.isnan(fitting._widest(None, None)).all()


def test_all_results_are_those_of_the_command_line(walk_file: pathlib.Path, tmp_path: pathlib.Path) -> None:
    plantar("fit", walk_file, "--out", tmp_path / "params.toml", "--json", tmp_path / "fit.json")
    fit = package.fit(walk_file)
    assert fit.results == json.loads((tmp_path / "fit.json").read_text())
    fitted = fit.table().query("fitted")
    # With counted cells, the error of the prediction is another one.
    assert fitted["nrmse_predicted_counted_percent"].notna().all()
    assert (fitted["nrmse_predicted_counted_percent"] != fitted["nrmse_predicted_percent"]).all()


def test_the_curves_of_a_fit_have_its_error(walk_file: pathlib.Path) -> None:
    fit = package.fit(walk_file)
    steps = fit.curves.groupby(["region", "recording", "step"])
    # NRMSE (Eq. 20): root mean square of model minus measured force, divided by the largest measured force.
    error_percent = steps.apply(
        lambda step: float(
            np.sqrt(((step["model_force_n"] - step["measured_force_n"]) ** 2).mean()) / step["measured_force_n"].max() * 100
        )
    )
    means = error_percent.groupby(level="region").mean()
    table = fit.table().query("fitted")
    assert set(means.index) == set(table.index)
    np.testing.assert_allclose(means[table.index], table["nrmse_fitted_percent"].astype(float), rtol=1e-9)


def test_a_recording_that_is_given_twice_and_an_empty_list_are_errors(
    walk_file: pathlib.Path, tmp_path: pathlib.Path
) -> None:
    with pytest.raises(ValueError, match="walk.parquet has the same pressures as .*walk.parquet"):
        package.fit([walk_file, walk_file])
    copy = tmp_path / "copy.parquet"
    copy.write_bytes(walk_file.read_bytes())
    for people in ([walk_file, copy], {"ann": [walk_file, copy]}, {"ann": [walk_file], "bob": [copy]}):
        with pytest.raises(ValueError, match="copy.parquet has the same pressures as .*walk.parquet"):
            package.repeat(people)
    with pytest.raises(ValueError, match="no recording"):
        package.fit([])


def test_repeatability_is_that_of_the_command_line(study_folder: pathlib.Path, tmp_path: pathlib.Path) -> None:
    # Only the recordings are copied: the function of the package does not read participant.toml.
    (study_folder.parent / "people").mkdir()
    people = {}
    for name in ("ann", "cid", "dan"):
        files = sorted((study_folder / name).glob("*.parquet"))
        folder = study_folder.parent / "people" / name
        folder.mkdir()
        people[name] = [folder / file.name for file in files]
        for file in files:
            (folder / file.name).write_bytes(file.read_bytes())
    plantar("repeat", study_folder.parent / "people", "--csv", tmp_path / "repeat.csv")
    expected = pd.read_csv(tmp_path / "repeat.csv").set_index(["side", "variable", "region"])
    found = package.repeat(people)
    pd.testing.assert_frame_equal(found, expected, check_dtype=False, rtol=1e-12)
    with pytest.raises(ValueError, match="record another trial"):
        package.repeat(people["ann"][:1])


def recordings_of(study_folder: pathlib.Path) -> dict[str, list[pathlib.Path]]:
    """The recordings of each participant, sorted by name."""
    return {folder.name: sorted(folder.glob("*.parquet")) for folder in sorted(study_folder.iterdir())}


def test_repeatability_with_options_of_each_person_is_that_of_a_study(
    study_folder: pathlib.Path, tmp_path: pathlib.Path
) -> None:
    plantar("repeat", study_folder, "--csv", tmp_path / "repeat.csv")
    expected = pd.read_csv(tmp_path / "repeat.csv").set_index(["side", "variable", "region"])
    people = recordings_of(study_folder)
    # The file participant.toml has this size.
    options = {name: package.Options(size=37 if name == "ann" else 42) for name in people}
    found = package.repeat(people, options=options)
    pd.testing.assert_frame_equal(found, expected, check_dtype=False, rtol=1e-12)
    assert not found.equals(package.repeat(people))
    with pytest.raises(ValueError, match="options of ann, but recordings of ann, bob"):
        package.repeat(people, options={"ann": package.Options()})
    with pytest.raises(ValueError, match="may differ only in size, tissue and zero"):
        package.repeat(people, options={**options, "cid": package.Options(contact_on_kpa=20)})


def test_repeatability_is_that_of_the_first_trials_given(study_folder: pathlib.Path) -> None:
    people = recordings_of(study_folder)
    ann, cid, other = people["ann"], people["cid"], people["dan"][0]
    expected = package.repeat({"ann": ann, "cid": cid})
    pd.testing.assert_frame_equal(package.repeat({"ann": ann, "cid": [*cid, other]}), expected)
    assert not package.repeat({"ann": ann, "cid": [other, *cid]}).equals(expected)


def test_a_single_step_has_no_predicted_error(tmp_path: pathlib.Path) -> None:
    table = package.fit(walk(tmp_path / "one.parquet", "--steps", 1)).table().query("fitted")
    assert table["nrmse_predicted_percent"].isna().all() and table["nrmse_fitted_percent"].notna().all()
