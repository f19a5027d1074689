"""The cohort on Dask has the rows of `plantar cohort`, continues after an interruption, and tolerates failures."""

import contextlib
import os
import pathlib
import shutil
import socket
import subprocess
import sys
import urllib.error
import urllib.request
from collections.abc import Iterator
from typing import Any

import distributed
import fsspec
import pandas as pd
import pyarrow.parquet as pq
import pytest
from conftest import plantar as plantar_program
from conftest import walk
from fsspec.implementations.local import LocalFileSystem

import plantar
from plantar import cohort

COHORT_ON_DASK = [sys.executable, "-m", "plantar.cohort"]


def table(folder: pathlib.Path) -> pd.DataFrame:
    """All rows of the table, as pandas reads them."""
    rows: pd.DataFrame = pd.read_parquet(folder)
    return rows.sort_values(["participant", "recording", "step", "region"], ignore_index=True)


@pytest.fixture(scope="module")
def expected(study_folder: pathlib.Path, tmp_path_factory: pytest.TempPathFactory) -> pd.DataFrame:
    """The rows of `plantar cohort`."""
    out = tmp_path_factory.mktemp("expected") / "table"
    plantar_program("cohort", study_folder, "--out", out)
    return table(out)


@contextlib.contextmanager
def dask(*words: object) -> Iterator[subprocess.Popen[bytes]]:
    """A process of Dask's command line, which is killed on exit."""
    with subprocess.Popen([sys.executable, "-m", "dask", *map(str, words)], stderr=subprocess.DEVNULL) as process:
        try:
            yield process
        finally:
            process.kill()


def free_port() -> int:
    with socket.socket() as listener:
        listener.bind(("127.0.0.1", 0))
        port: int = listener.getsockname()[1]
        return port


@contextlib.contextmanager
def scheduler(workers: int) -> Iterator[tuple[str, list[subprocess.Popen[bytes]]]]:
    """Starts a scheduler and workers as a user does. Yields the address, and the processes, that of the scheduler first."""
    address = f"tcp://127.0.0.1:{free_port()}"
    with contextlib.ExitStack() as stack:
        port = address.rsplit(":", 1)[1]
        head = stack.enter_context(dask("scheduler", "--host", "127.0.0.1", "--port", port, "--no-dashboard"))
        worker = ("worker", address, "--nthreads", 1, "--no-dashboard", "--no-nanny", "--host", "127.0.0.1")
        processes = [head, *(stack.enter_context(dask(*worker)) for _ in range(workers))]
        with distributed.Client(address, timeout="60s") as client:
            client.wait_for_workers(workers, timeout=60)
        yield address, processes


@pytest.mark.parametrize("local", ["threads", "processes"])
def test_a_local_run_has_the_rows_of_the_command_line(
    local: str, study_folder: pathlib.Path, expected: pd.DataFrame, tmp_path: pathlib.Path
) -> None:
    completed = subprocess.run(
        [*COHORT_ON_DASK, study_folder, "--out", tmp_path / "table", "--scheduler", local],
        capture_output=True,
        text=True,
        check=False,
    )
    assert completed.returncode == 0, completed.stderr
    assert "16 steps of 4 participants" in completed.stdout
    assert len(expected) == 8 * 16
    pd.testing.assert_frame_equal(table(tmp_path / "table"), expected)


def test_options_are_those_of_the_command_line(study_folder: pathlib.Path, tmp_path: pathlib.Path) -> None:
    options = ["--size", "44", "--bounds", "paper", "--filter", "live", "--contact-on", "12", "--compression", "0.4"]
    options += ["--thresholds", "absolute", "--strike", "300", "--release", "250"]
    options += ["--min-stance", "100", "--min-swing", "60", "--max-stance", "2000"]
    assert cohort.main([str(study_folder), "--out", str(tmp_path / "dask"), *options]) == 0
    plantar_program("cohort", study_folder, "--out", tmp_path / "rust", *options)
    pd.testing.assert_frame_equal(table(tmp_path / "dask"), table(tmp_path / "rust"))


@pytest.mark.parametrize("local", ["threads", "processes"])
def test_other_programs_cannot_use_the_cluster_of_a_local_run(local: str) -> None:
    client = cohort._client(local)
    cluster = client.cluster
    assert cluster is not None
    try:
        address = cluster.scheduler_address
        port = client.scheduler_info()["services"]["dashboard"]
        with pytest.raises(urllib.error.HTTPError, match="404"):
            urllib.request.urlopen(f"http://127.0.0.1:{port}/json/identity.json")
        if local == "threads":
            assert address.startswith("inproc://")
            return
        assert address.startswith("tls://127.0.0.1:")
        with pytest.raises(OSError):
            distributed.Client(address.replace("tls://", "tcp://"), timeout="2s")
        # With a key of its own, but not that of the cluster.
        with pytest.raises(OSError):
            distributed.Client(address, timeout="2s", security=distributed.Security.temporary())
    finally:
        client.close()
        cluster.close()


def test_two_workers_of_a_scheduler_write_the_rows_of_the_command_line(
    study_folder: pathlib.Path, expected: pd.DataFrame, tmp_path: pathlib.Path
) -> None:
    with scheduler(2) as (address, _):
        outcomes = cohort.run(study_folder, tmp_path / "table", scheduler=address)
    assert [outcome.steps for outcome in outcomes] == [4] * 4
    pd.testing.assert_frame_equal(table(tmp_path / "table"), expected)


def test_the_rows_are_complete_although_a_worker_is_killed(
    study_folder: pathlib.Path, expected: pd.DataFrame, tmp_path: pathlib.Path
) -> None:
    with scheduler(2) as (address, processes):
        killed: list[int] = []

        def kill(done: int, total: int) -> None:
            # Three participants remain, so each of the two workers has at least one of them.
            if not killed:
                processes[1].kill()
                killed.append(processes[1].wait())

        cohort.run(study_folder, tmp_path / "table", scheduler=address, progress=kill)
        assert killed
    pd.testing.assert_frame_equal(table(tmp_path / "table"), expected)


def test_finished_participants_remain_when_the_scheduler_is_lost(
    study_folder: pathlib.Path, expected: pd.DataFrame, tmp_path: pathlib.Path
) -> None:
    out = tmp_path / "table"
    with scheduler(1) as (address, (head, _)):

        def kill(done: int, total: int) -> None:
            head.kill()
            head.wait()

        with pytest.raises(ConnectionError, match=f"{address} was lost: run the same command again"):
            cohort.run(study_folder, out, scheduler=address, progress=kill)
    assert list(out.glob("participant=*/steps.parquet"))
    assert any(outcome.is_cached for outcome in cohort.run(study_folder, out))
    pd.testing.assert_frame_equal(table(out), expected)


def test_a_second_run_evaluates_only_the_remaining_participants(
    study_folder: pathlib.Path, expected: pd.DataFrame, tmp_path: pathlib.Path
) -> None:
    out = tmp_path / "table"
    assert cohort.evaluate("ann", str(study_folder), str(out), plantar.Options()).steps == 4
    written = next(out.glob("participant=ann/*.parquet")).stat().st_mtime_ns
    outcomes = cohort.run(study_folder, out)
    assert [(outcome.is_cached, outcome.steps) for outcome in outcomes] == [(True, 4)] + [(False, 4)] * 3
    assert next(out.glob("participant=ann/*.parquet")).stat().st_mtime_ns == written
    pd.testing.assert_frame_equal(table(out), expected)
    assert all(outcome.is_cached for outcome in cohort.run(study_folder, out))


def test_rows_of_an_earlier_run_are_removed_if_a_task_fails(
    study_folder: pathlib.Path, tmp_path: pathlib.Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def fail(participant: str, study: str, out: str, options: plantar.Options) -> cohort.Outcome:
        raise RuntimeError(participant)

    out, names = tmp_path / "table", ["ann", "bob=b.", "cid", "dan"]
    cohort.run(study_folder, out)
    assert len(list(out.glob("participant=*/steps.parquet"))) == len(names)
    monkeypatch.setattr(cohort, "evaluate", fail)
    outcomes = cohort.run(study_folder, out)
    assert [outcome.left_out for outcome in outcomes] == [(f"{name}: RuntimeError('{name}')",) for name in names]
    assert not list(out.glob("participant=*/steps.parquet"))


def test_invalid_options_remove_no_rows(
    study_folder: pathlib.Path, expected: pd.DataFrame, tmp_path: pathlib.Path, capsys: pytest.CaptureFixture[str]
) -> None:
    arguments = [str(study_folder), "--out", str(tmp_path / "table")]
    assert cohort.main(arguments) == 0
    for invalid in (["--contact-on", "5", "--contact-off", "10"], ["--tissue", str(tmp_path / "missing.toml")]):
        assert cohort.main(arguments + invalid) == 1
        assert capsys.readouterr().err.count("error: ") == 1
        pd.testing.assert_frame_equal(table(tmp_path / "table"), expected)


def test_a_zero_file_for_all_participants_is_refused(study_folder: pathlib.Path, tmp_path: pathlib.Path) -> None:
    options, out = plantar.Options(zero=tmp_path / "zero.toml"), tmp_path / "table"
    with pytest.raises(ValueError, match="zero.toml' is for the recordings of one person: .* in participant.toml"):
        cohort.run(study_folder, out, options=options)
    with pytest.raises(ValueError, match="participant.toml"):
        cohort.evaluate("ann", str(study_folder), str(out), options)
    assert not out.exists()


def test_rows_of_a_participant_without_a_folder_are_noted(
    study_folder: pathlib.Path, tmp_path: pathlib.Path, capsys: pytest.CaptureFixture[str]
) -> None:
    study, out = tmp_path / "study", tmp_path / "table"
    shutil.copytree(study_folder, study)
    assert cohort.main([str(study), "--out", str(out)]) == 0
    assert "no folder" not in capsys.readouterr().err
    (study / "ann").rename(study / "anna")
    assert cohort.main([str(study), "--out", str(out)]) == 0
    notes = [line for line in capsys.readouterr().err.splitlines() if "no folder" in line]
    assert len(notes) == 1
    assert "participant=ann/" in notes[0]
    with pytest.warns(UserWarning, match="the table has .*participant=ann/.* has no folder: remove the file") as caught:
        cohort.run(study, out)
    assert [warning.filename for warning in caught] == [__file__]


def test_a_folder_with_only_the_table_is_no_participant(study_folder: pathlib.Path, tmp_path: pathlib.Path) -> None:
    study, names = tmp_path / "study", ["ann", "bob=b.", "cid", "dan"]
    shutil.copytree(study_folder, study)
    out = study / "results" / "table"
    for _ in range(2):
        assert cohort.main([str(study), "--out", str(out)]) == 0
    assert cohort.participants(str(study), str(out)) == names
    # The folder of an earlier table is no participant, either.
    assert cohort.participants(str(study), str(tmp_path / "elsewhere")) == names
    # A folder with recordings is that of a participant, even if it contains the table.
    assert cohort.participants(str(study), str(study / "ann" / "table")) == names
    with pytest.raises(OSError, match="folder of the study"):
        cohort.participants(str(study), f"{study}/")
    with pytest.raises(OSError, match="choose another --out"):
        cohort.participants(str(study), str(study / "ann"))


def test_tables_are_not_searched_for_in_hidden_folders_and_links(
    study_folder: pathlib.Path, tmp_path: pathlib.Path
) -> None:
    study = tmp_path / "study"
    shutil.copytree(study_folder, study)
    for folder in ("results/table", ".snapshots", "eve/.snapshots"):
        (study / folder / "participant=ann").mkdir(parents=True)
    # The study contains a table, so a search that follows this link finds one.
    (study / "fay").mkdir()
    (study / "fay" / "back").symlink_to(study, target_is_directory=True)
    # The folders without recordings remain participants, so that they are reported.
    names = ["ann", "bob=b.", "cid", "dan", "eve", "fay"]
    assert cohort.participants(str(study), str(tmp_path / "elsewhere")) == names


def test_a_folder_that_cannot_be_listed_may_be_that_of_a_participant(
    study_folder: pathlib.Path, tmp_path: pathlib.Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    study = tmp_path / "study"
    shutil.copytree(study_folder, study)
    # Permissions have no effect on the superuser, so the test replaces the listing by one that fails.
    locked = [study / "eve", study / "fay" / "private", study / ".snapshots"]
    list_folder = LocalFileSystem.ls

    def refuse(files: LocalFileSystem, path: str, *arguments: Any, **options: Any) -> Any:
        if pathlib.Path(path) in locked:
            raise PermissionError(path)
        return list_folder(files, path, *arguments, **options)

    for folder in locked:
        (folder / "participant=ann").mkdir(parents=True)
    monkeypatch.setattr(LocalFileSystem, "ls", refuse)
    names = ["ann", "bob=b.", "cid", "dan", "eve", "fay"]
    assert cohort.participants(str(study), str(tmp_path / "elsewhere")) == names
    # The evaluation reports the reason.
    outcome = cohort.evaluate("eve", str(study), str(tmp_path / "table"), plantar.Options())
    assert outcome.steps == 0 and "eve" in outcome.left_out[0]


def test_hidden_files_are_not_recordings(study_folder: pathlib.Path, tmp_path: pathlib.Path) -> None:
    study, out = tmp_path / "study", tmp_path / "table"
    shutil.copytree(study_folder, study)
    (study / "ann" / "._0.parquet").write_bytes(b"attributes")
    outcome = cohort.evaluate("ann", str(study), str(out), plantar.Options())
    assert (outcome.steps, outcome.left_out) == (4, ())


def test_misplaced_and_misnamed_files_are_left_out_and_named(
    study_folder: pathlib.Path, tmp_path: pathlib.Path, capsys: pytest.CaptureFixture[str]
) -> None:
    study = tmp_path / "study"
    shutil.copytree(study_folder, study)
    ann = study / "ann"
    (ann / "day2" / "shod").mkdir(parents=True)
    (ann / "results" / "participant=ann").mkdir(parents=True)
    for copy in ("day2/shod/a.parquet", "day2/B.PARQUET", "X.PARQUET", "results/participant=ann/steps.parquet"):
        shutil.copy(ann / "0.parquet", ann / copy)
    shutil.copy(ann / "0.parquet", study / "lost.parquet")
    expected = [
        ("study/ann/X.PARQUET: ", "in lower case"),
        ("study/ann/day2: ", "are not used (2)"),
        ("study/lost.parquet: ", "not in the folder of a participant"),
    ]
    # The second run finds the participants up to date.
    for cached in (0, 4):
        assert cohort.main([str(study), "--out", str(tmp_path / "table")]) == 3
        captured = capsys.readouterr()
        assert f"; participants already up to date: {cached}" in captured.out
        left_out = [line for line in captured.err.splitlines() if line.startswith("left out: ")]
        assert len(left_out) == len(expected), captured.err
        for line, (name, reason) in zip(left_out, expected, strict=True):
            assert name in line and reason in line
    # `plantar cohort` leaves out the same files.
    text = plantar_program("cohort", study, "--out", tmp_path / "rust", status=3)
    for name, reason in expected:
        assert any(name in line and reason in line for line in text.splitlines()), text
    # A warning for the participant, and one for the study.
    with pytest.warns(UserWarning) as caught:
        cohort.run(study, tmp_path / "table")
    of_ann, of_study = [str(warning.message) for warning in caught if warning.filename == __file__]
    assert of_ann.startswith("ann: left out: ") and of_ann.count(" | left out: ") == 1
    assert all(name in of_ann and reason in of_ann for name, reason in expected[:2])
    assert all(words in of_study for words in expected[2])


def test_a_recording_in_parts_has_the_rows_of_the_command_line(tmp_path: pathlib.Path) -> None:
    study, parts = tmp_path / "study", tmp_path / "study" / "ann" / "walk.parquet"
    parts.mkdir(parents=True)
    whole = pq.read_table(walk(tmp_path / "walk.parquet", "--steps", 4))
    middle = whole.num_rows // 2
    pq.write_table(whole.slice(0, middle), parts / "part-0.parquet")
    pq.write_table(whole.slice(middle), parts / "part-1.parquet")
    (parts / "._part-1.parquet").write_bytes(b"attributes")
    plantar_program("cohort", study, "--out", tmp_path / "rust")
    expected = table(tmp_path / "rust")
    assert len(expected) == 8 * 4
    assert set(expected["recording"]) == {"walk.parquet"}

    def evaluate(root: str) -> cohort.Outcome:
        return cohort.evaluate("ann", f"{root}/study", f"{root}/dask", plantar.Options())

    outcome = evaluate(str(tmp_path))
    assert (outcome.steps, outcome.left_out) == (4, ())
    pd.testing.assert_frame_equal(table(tmp_path / "dask"), expected)
    # A changed part causes a new evaluation.
    assert evaluate(str(tmp_path)).is_cached
    os.utime(parts / "part-1.parquet")
    assert not evaluate(str(tmp_path)).is_cached
    memory = fsspec.filesystem("memory")
    memory.put(str(study), "/parts/study", recursive=True)
    evaluate("memory://parts")
    memory.get("/parts/dask", str(tmp_path / "from-memory"), recursive=True)
    pd.testing.assert_frame_equal(table(tmp_path / "from-memory"), expected)


def test_a_folder_that_lists_itself_has_only_its_parts() -> None:
    class Listing:
        """An object storage that lists a folder as an object without content in this folder."""

        def invalidate_cache(self, path: str) -> None:
            """Does nothing, because there is no cache."""

        def ls(self, path: str, detail: bool) -> list[dict[str, object]]:
            names = [f"{path}/", f"{path}/part-0.parquet"]
            return [{"name": name, "type": "file", "size": 0} for name in names]

    names = [entry["name"] for entry in cohort._parquet_entries(Listing(), "study/ann/walk.parquet")]
    assert names == ["study/ann/walk.parquet/part-0.parquet"]


def test_an_unreachable_scheduler_is_an_error_that_names_the_remedy(
    study_folder: pathlib.Path, tmp_path: pathlib.Path
) -> None:
    address = f"tcp://127.0.0.1:{free_port()}"
    with pytest.raises(ConnectionError, match=f"{address} cannot be reached: start it with `dask scheduler`"):
        cohort.run(study_folder, tmp_path / "table", scheduler=address)
    with pytest.raises(ConnectionError, match="form tls://HOST:8786 or"):
        cohort.run(study_folder, tmp_path / "table", scheduler="nonsense")
    assert cohort.main([str(study_folder), "--out", str(tmp_path / "table"), "--scheduler", address]) == 1
    assert not (tmp_path / "table").exists()


def test_an_unusable_recording_is_reported_and_tried_again(
    study_folder: pathlib.Path, expected: pd.DataFrame, tmp_path: pathlib.Path, capsys: pytest.CaptureFixture[str]
) -> None:
    study, out = tmp_path / "study", tmp_path / "table"
    shutil.copytree(study_folder, study)
    (study / "cid").rename(tmp_path / "elsewhere")
    (study / "cid").symlink_to(tmp_path / "elsewhere")
    damaged = study / "ann" / "0.parquet"
    good = damaged.read_bytes()
    damaged.write_bytes(good[:1000])
    (study / "nobody").mkdir()
    (study / "dan" / "participant.toml").write_text("size = 99")
    assert cohort.main([str(study), "--out", str(out)]) == 3
    text = capsys.readouterr().err
    for words in ("ann/0.parquet: the file is cut off", "nobody: no recording (*.parquet)", "dan/participant.toml"):
        assert words in text
    rows = table(out)
    assert rows.groupby("participant", observed=True).size().to_dict() == {"ann": 16, "bob=b.": 32, "cid": 32}
    with pytest.warns(UserWarning) as caught:
        cohort.run(study, out)
    texts = [str(warning.message) for warning in caught if warning.filename == __file__]
    starts = ("ann: left out: ", "dan: left out: ", "nobody: left out: ")
    assert all(text.startswith(start) for text, start in zip(texts, starts, strict=True))
    damaged.write_bytes(good)
    (study / "nobody").rmdir()
    (study / "dan" / "participant.toml").unlink()
    outcomes = cohort.run(study, out)
    assert [outcome.is_cached for outcome in outcomes] == [False, True, True, False]
    pd.testing.assert_frame_equal(table(out), expected)
    # A changed file or option causes a new evaluation.
    os.utime(damaged)
    assert [outcome.is_cached for outcome in cohort.run(study, out)] == [False, True, True, True]
    assert not any(o.is_cached for o in cohort.run(study, out, options=plantar.Options(compression=0.3)))


def test_a_study_in_object_storage_has_equal_rows(
    study_folder: pathlib.Path, expected: pd.DataFrame, tmp_path: pathlib.Path
) -> None:
    # fsspec's in-memory file system has the same interface as object stores and, like them, no real folders or renames.
    memory = fsspec.filesystem("memory")
    memory.put(str(study_folder), "/bucket/study", recursive=True)
    outcomes = cohort.run("memory://bucket/study", "memory://bucket/table")
    assert [outcome.steps for outcome in outcomes] == [4] * 4
    assert all(outcome.is_cached for outcome in cohort.run("memory://bucket/study", "memory://bucket/table"))
    memory.get("/bucket/table", str(tmp_path), recursive=True)
    pd.testing.assert_frame_equal(table(tmp_path / "table"), expected)


def test_incomplete_results_are_named_and_a_shared_file_in_object_storage_is_read(
    study_folder: pathlib.Path, capsys: pytest.CaptureFixture[str]
) -> None:
    memory = fsspec.filesystem("memory")
    memory.put(str(study_folder / "ann"), "/shared/study/ann", recursive=True)
    memory.pipe("/shared/study/ann/participant.toml", b'tissue = "../tissue.toml"')
    contradiction = b"[heel]\nthickness_mm = 17\npeak_strain = 0.4\ncurvature_mm = [400, 400]\n"
    memory.pipe("/shared/study/tissue.toml", contradiction)
    # The second run reads from the table why results are incomplete.
    for cached in range(2):
        assert cohort.main(["memory://shared/study", "--out", "memory://shared/table"]) == 3
        out, text = capsys.readouterr()
        assert f"; participants already up to date: {cached}" in out
        assert "incomplete: ann, 0.parquet, heel: measurements contradict each other" in text and "left out" not in text
    with pytest.warns(UserWarning, match="^ann: incomplete: ann, 0.parquet, heel: measurements "):
        cohort.run("memory://shared/study", "memory://shared/table")
    # With a thickness (mm) only, no measurements contradict each other.
    memory.pipe("/shared/study/tissue.toml", b"heel = 17")
    assert cohort.main(["memory://shared/study", "--out", "memory://shared/table"]) == 0


def test_a_study_without_participants_is_an_error(tmp_path: pathlib.Path) -> None:
    with pytest.raises(OSError, match="one folder per participant"):
        cohort.run(tmp_path / "nowhere", tmp_path / "table")
    (tmp_path / "study").mkdir()
    with pytest.raises(OSError, match="no participant"):
        cohort.run(tmp_path / "study", tmp_path / "table")
    # Without any step, there is no table either.
    (tmp_path / "study" / "nobody").mkdir()
    with pytest.warns(UserWarning, match="^nobody: left out: .*no recording"):
        assert cohort.run(tmp_path / "study", tmp_path / "table")[0].steps == 0
