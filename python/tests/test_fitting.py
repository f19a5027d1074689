"""Fits and repeatability, compared with the command line and with closed forms."""

import json
import pathlib
import tomllib
import warnings

import numpy as np
import pandas as pd
import pyarrow as pa
import pyarrow.parquet as pq
import pytest
from conftest import plantar, walk

import plantar as package
from plantar import fitting


FLAGS = {"ab": "ab_m2", "stiffness": "stiffness_pa", "damping": "damping_pa_s", "n": "n", "m": "m"}
"""The names of the parameters in the marks of the table, and in the results."""


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
        intervals = result["uncertainty"]["intervals_95"]
        for flag, name in FLAGS.items():
            assert row[f"{flag}_identifiable"] == intervals[name]["is_identifiable"], (region, name)
            assert row[f"{flag}_at_bound"] == intervals[name]["at_bound"], (region, name)
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


def test_the_table_has_the_quantities_with_the_names_of_the_table_of_a_cohort(walk_file: pathlib.Path) -> None:
    fit = package.fit(walk_file)
    table = fit.table()
    for region, result in fit.results["regions"].items():
        row = table.loc[region]
        assert set(result["quantities"]) <= set(fitting.QUANTITIES)
        for name in fitting.QUANTITIES:
            if name not in result["quantities"]:
                assert np.isnan(row[name]) and np.isnan(row[f"{name}_low"])
                continue
            expected = result["quantities"][name]
            assert [row[name], row[f"{name}_low"], row[f"{name}_high"]] == [expected["value"], *expected["interval_95"]]
    assert table["force_at_70_percent_area_n"].notna().all() and table["secant_modulus_kpa"].notna().any()
    # A toe does not reach 200 N.
    assert table["area_at_200_n_mm2"].isna().any()
    columns = package.fit_steps(walk_file).column_names
    first, last = columns.index(fitting.QUANTITIES[0]), columns.index(fitting.QUANTITIES[-1])
    assert tuple(columns[first : last + 1]) == fitting.QUANTITIES


def test_a_fit_is_described_in_one_line(walk_file: pathlib.Path, tmp_path: pathlib.Path) -> None:
    assert repr(package.fit(walk_file)) == (
        "<Fit of walk: 6 steps of 1 recording, direct filter, 8 of 8 regions fitted>"
    )
    one = package.fit(walk(tmp_path / "one.parquet", "--steps", 1), participant="ann")
    assert repr(one).startswith("<Fit of ann: 1 step of 1 recording, ")
    assert repr(one).endswith(" with incomplete results>")


def test_the_curves_of_a_fit_have_its_error(walk_file: pathlib.Path) -> None:
    fit = package.fit(walk_file)
    steps = fit.curves.groupby(["region", "recording", "step"], observed=True)
    assert list(fit.curves["region"].cat.categories) == list(package.REGIONS)
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


def by_text(repeatability: pd.DataFrame) -> pd.DataFrame:
    """The table with the names of the regions as text, as in a file."""
    names = repeatability.index.names
    return repeatability.reset_index().astype({"region": str}).set_index(names)


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
    pd.testing.assert_frame_equal(by_text(found), expected, check_dtype=False, rtol=1e-12)
    # Regions are sorted from heel to toes.
    regions = found.xs(("right", "secant_modulus_kpa"), level=("side", "variable")).sort_index().index
    assert list(regions) == [region for region in package.REGIONS if region in set(regions)]
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
    pd.testing.assert_frame_equal(by_text(found), expected, check_dtype=False, rtol=1e-12)
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


def test_people_who_are_left_out_of_a_comparison_are_named(study_folder: pathlib.Path) -> None:
    people = recordings_of(study_folder)
    people = {"ann": people["ann"], "cid": people["cid"], "dan": people["dan"][:1]}
    with pytest.warns(UserWarning, match="left out: dan, right foot: only one usable recording"):
        package.repeat(people)


def test_each_incomplete_result_of_a_trial_and_of_a_step_is_a_warning(
    study_folder: pathlib.Path, tmp_path: pathlib.Path
) -> None:
    tissue = tmp_path / "tissue.toml"
    tissue.write_text("[heel]\nthickness_mm = 17\npeak_strain = 0.4\ncurvature_mm = [400, 400]\n")
    options = package.Options(tissue=tissue)
    trials = recordings_of(study_folder)["ann"]
    with pytest.warns(UserWarning, match="incomplete: the person, 1, heel: measurements contradict each other"):
        package.repeat(trials, options=options)
    with pytest.warns(UserWarning, match="incomplete: .*ann/0.parquet, heel: measurements contradict"):
        rows = package.fit_steps(trials[0], options=options).to_pandas()
    heel = rows[rows["region"] == "heel"]
    assert heel["c_by"].eq("assumed_compression").all() and heel["defects"].notna().all()
    assert rows[rows["region"] != "heel"]["defects"].isna().all() and rows["masked_cells"].eq(0).all()


def test_a_single_step_has_no_predicted_error(tmp_path: pathlib.Path) -> None:
    path = walk(tmp_path / "one.parquet", "--steps", 1)
    with pytest.warns(UserWarning, match="only one step could be used"):
        table = package.fit(path).table().query("fitted")
    assert table["nrmse_predicted_percent"].isna().all() and table["nrmse_fitted_percent"].notna().all()


def warnings_of_a_fit(recording: pathlib.Path, tissue: pathlib.Path | None) -> tuple[list[str], pd.DataFrame]:
    """The texts of the warnings of a fit, which must be those of a call in this file, and the table of the fit."""
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        fit = package.fit(recording, options=package.Options(size=42, tissue=tissue))
    assert all(warning.category is UserWarning and warning.filename == __file__ for warning in caught)
    return [str(warning.message) for warning in caught], fit.table()


def test_each_defect_that_the_command_line_prints_is_a_warning_and_in_the_table(
    walk_file: pathlib.Path, tmp_path: pathlib.Path
) -> None:
    contradiction, out_of_range = tmp_path / "contradiction.toml", tmp_path / "out_of_range.toml"
    contradiction.write_text("[heel]\nthickness_mm = 17\npeak_strain = 0.4\ncurvature_mm = [400, 400]\n")
    out_of_range.write_text("heel = 99\n")
    one_step = walk(tmp_path / "one.parquet", "--steps", 1)
    for recording, tissue, words, remedy in (
        (walk_file, contradiction, "measurements contradict each other", "measure this region again"),
        (walk_file, out_of_range, "thickness_mm = 99 is out of range", "correct the value"),
        (one_step, contradiction, "only one step could be used", "record at least ten steps"),
    ):
        printed = plantar("fit", recording, "--tissue", tissue, "--out", tmp_path / "params.toml", status=3)
        texts, table = warnings_of_a_fit(recording, tissue)
        region, expected = "", []
        for line in printed.splitlines():
            if line.startswith("    INCOMPLETE: "):
                expected.append((region, line.removeprefix("    INCOMPLETE: ")))
            elif line.partition(":")[0] in package.REGIONS:
                region = line.partition(":")[0]
        assert expected and len(texts) == len(expected)
        for text, (region, defect) in zip(texts, expected, strict=True):
            # The command line, too, has a note with the name of the file if a value is out of range.
            assert text in (f"{recording.stem}, {region}: INCOMPLETE: {defect}", f"{tissue}: {region}: {defect}")
        [in_heel] = [text for text in texts if "heel: " in text and words in text]
        assert remedy in in_heel
        in_table = table["defects"].dropna().str.split(" | ", regex=False).explode()
        assert list(in_table.items()) == expected
    # The heel has both defects of the last fit.
    assert (in_table.index == "heel").sum() == 2


def test_a_complete_fit_has_no_warning_and_no_defect(walk_file: pathlib.Path) -> None:
    texts, table = warnings_of_a_fit(walk_file, None)
    assert texts == [] and table["defects"].isna().all()


def test_the_remarks_on_regions_are_in_the_table(walk_file: pathlib.Path, tmp_path: pathlib.Path) -> None:
    printed = plantar("fit", walk_file, "--size", 42, "--out", tmp_path / "params.toml")
    remarks = package.fit(walk_file, options=package.Options(size=42)).table()["warnings"]
    in_table = [remark for text in remarks.dropna() for remark in text.split(" | ")]
    indented = [line[4:] for line in printed.splitlines() if line.startswith("    ")]
    assert in_table == indented and len(in_table) >= 8


def notes_of_a_fit(recordings: list[pathlib.Path], options: package.Options) -> list[str]:
    """The texts of the warnings of a fit."""
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        package.fit(recordings, options=options)
    assert all(warning.category is UserWarning and warning.filename == __file__ for warning in caught)
    return [str(warning.message) for warning in caught]


def test_an_assumed_size_is_noted_unless_the_thickness_is_measured(
    walk_file: pathlib.Path, tmp_path: pathlib.Path
) -> None:
    printed = plantar("fit", walk_file, "--out", tmp_path / "params.toml")
    assert "note: size 42 assumed for the typical thickness of the tissue" in printed
    [note] = notes_of_a_fit([walk_file], package.Options())
    assert note.startswith("walk: size 42 assumed for the typical thickness of the tissue: state")
    assert notes_of_a_fit([walk_file], package.Options(size=42)) == []
    tissue = tmp_path / "tissue.toml"
    tissue.write_text("".join(f"{region} = 12.0\n" for region in package.REGIONS))
    assert notes_of_a_fit([walk_file], package.Options(tissue=tissue)) == []


def test_a_fit_of_both_feet_is_noted_as_on_the_command_line(walk_file: pathlib.Path, tmp_path: pathlib.Path) -> None:
    left = walk(tmp_path / "walk.left.parquet", "--side", "left", "--steps", 4)
    printed = plantar("fit", walk_file, left, "--size", 42, "--out", tmp_path / "params.toml")
    [expected] = [line.removeprefix("Note: ") for line in printed.splitlines() if "both feet together" in line]
    notes = notes_of_a_fit([walk_file, left], package.Options(size=42))
    assert notes == [f"walk: {expected.removesuffix('.')}"] and "6 steps of the left" not in expected


@pytest.mark.parametrize(
    ("file_name", "subject"),
    [("pedar.left", "pedar"), ("ann-left", "ann"), ("left", "both feet"), ("cleft", "cleft"), ("walk", "walk")],
)
def test_the_name_of_a_person_with_both_feet_is_that_of_the_command_line(
    walk_file: pathlib.Path, tmp_path: pathlib.Path, file_name: str, subject: str
) -> None:
    left = walk(tmp_path / f"{file_name}.parquet", "--side", "left", "--steps", 4)
    plantar("fit", left, walk_file, "--out", tmp_path / "params.toml")
    package.fit([left, walk_file], options=package.Options(size=42)).write(tmp_path / "own.toml")
    own, other = (tomllib.loads((tmp_path / name).read_text())["subject"] for name in ("own.toml", "params.toml"))
    assert own == other == subject
    assert package.fit(left).results["participant"] == file_name


def with_layout(source: pathlib.Path, path: pathlib.Path, name: str, area: float, scale: float = 1.0) -> pathlib.Path:
    """A copy of a recording with another name of the layout, areas and pressures multiplied by the factors."""
    table = pq.read_table(source)
    meta = json.loads(table.schema.metadata[b"plantar"])
    meta["layout"]["name"] = name
    for cell in meta["layout"]["cells"]:
        cell["area_mm2"] *= area
    columns = [column.to_numpy() * np.float32(scale) for column in table.columns[1:]]
    changed = pa.table([table.column(0), *columns], schema=table.schema)
    pq.write_table(changed.replace_schema_metadata({"plantar": json.dumps(meta)}), path)
    return path


def test_recordings_of_different_sensors_are_noted_as_on_the_command_line(
    walk_file: pathlib.Path, tmp_path: pathlib.Path
) -> None:
    first = with_layout(walk_file, tmp_path / "first.parquet", "sole left, 240 cells", 1.0)
    for name, area, is_noted in (
        ("sole right, 200 cells", 1.2, False),
        ("sole left, 240 cells", 1.3, True),
        ("other sole", 1.0, True),
    ):
        other = with_layout(walk_file, tmp_path / "other.parquet", name, area, 1.02)
        printed = plantar("fit", first, other, "--size", 42, "--out", tmp_path / "params.toml")
        expected = [line.removeprefix("note: ") for line in printed.splitlines() if "different sensors" in line]
        assert notes_of_a_fit([first, other], package.Options(size=42)) == expected
        assert len(expected) == is_noted, name
    with pytest.warns(UserWarning, match="different sensors.* differences between the trials: .*or compare those"):
        package.repeat([first, other])


def test_contacts_that_were_left_out_are_noted(walk_file: pathlib.Path, tmp_path: pathlib.Path) -> None:
    cut = tmp_path / "cut.parquet"
    force_n = package.read(walk_file).force_n
    pq.write_table(pq.read_table(walk_file).slice(int(np.flatnonzero(force_n > 0.5 * force_n.max())[0])), cut)
    printed = plantar("fit", cut, "--size", 42, "--out", tmp_path / "params.toml")
    [expected] = [line.removeprefix("left out: ") for line in printed.splitlines() if line.startswith("left out: ")]
    [note] = notes_of_a_fit([cut], package.Options(size=42))
    assert note == f"cut: 1 contact left out: {expected}"


def test_a_region_that_was_not_fitted_has_a_reason_and_no_defect(
    walk_file: pathlib.Path, tmp_path: pathlib.Path
) -> None:
    short, tissue = tmp_path / "short.parquet", tmp_path / "tissue.toml"
    pq.write_table(pq.read_table(walk_file).slice(0, 20), short)
    tissue.write_text("heel = 99\n")
    texts, table = warnings_of_a_fit(short, tissue)
    # The value is out of range whether or not the heel was fitted.
    assert len(texts) == 2 and "heel: thickness_mm = 99 is out of range" in texts[0]
    assert texts[1].startswith("short: no region could be fitted: no whole step: record a walk")
    assert not table["fitted"].any() and table["reason"].notna().all() and table["defects"].isna().all()


def test_trials_of_one_person_by_name_cannot_be_compared_and_the_remedy_is_a_list(study_folder: pathlib.Path) -> None:
    trials = recordings_of(study_folder)["ann"]
    with pytest.raises(ValueError, match="2 or more people .* give the recordings of one person as a list"):
        package.repeat({"ann": trials})
    assert package.repeat(trials)["sem"].notna().any()
    with pytest.raises(ValueError, match="record another trial$"):
        package.repeat(trials[:1])


def test_a_list_is_no_remedy_if_nobody_has_two_trials(study_folder: pathlib.Path) -> None:
    people = recordings_of(study_folder)
    ann, bob = people["ann"], people["bob=b."]
    for too_few in ({"ann": ann[:1]}, {"ann": ann[:1], "bob": bob[:1]}):
        with pytest.raises(ValueError, match="record another trial$"):
            package.repeat(too_few)
    with pytest.raises(ValueError, match="give the recordings of one person as a list"):
        package.repeat({"ann": ann[:1], "bob": bob})
