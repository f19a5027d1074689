"""Computed walks, and the command line `plantar` as a separate process."""

import os
import pathlib
import subprocess

import pyarrow as pa
import pyarrow.compute as pc
import pyarrow.parquet as pq
import pytest

PROGRAM = os.environ.get("PLANTAR", "plantar")


def plantar(*arguments: object, cwd: pathlib.Path | None = None, status: int = 0) -> str:
    """Runs the command line, asserts that it ends with this exit status, and returns its output."""
    words = [PROGRAM, *map(str, arguments)]
    completed = subprocess.run(words, cwd=cwd, capture_output=True, text=True, check=False)
    assert completed.returncode == status, completed.stderr
    return completed.stdout + completed.stderr


def walk(path: pathlib.Path, *options: object, scale: float = 1.0) -> pathlib.Path:
    """Writes a computed walk, with its pressures multiplied by `scale`."""
    path.parent.mkdir(parents=True, exist_ok=True)
    plantar("import", "synthetic", *options, "--out", path)
    table = pq.read_table(path)
    for index, name in enumerate(table.column_names):
        if name != "t_s":
            scaled = pc.multiply(table[name], pa.scalar(scale, pa.float32()))
            table = table.set_column(index, table.schema.field(index), scaled)
    pq.write_table(table, path)
    return path


@pytest.fixture(scope="session")
def walk_file(tmp_path_factory: pytest.TempPathFactory) -> pathlib.Path:
    """A walk of six steps of the right foot."""
    return walk(tmp_path_factory.mktemp("walk") / "walk.parquet", "--steps", 6, "--side", "right")


@pytest.fixture(scope="session")
def study_folder(tmp_path_factory: pytest.TempPathFactory) -> pathlib.Path:
    """A study of four participants with two recordings each; one folder's name has a special character."""
    folder = tmp_path_factory.mktemp("study") / "study"
    for index, name in enumerate(["ann", "bob=b.", "cid", "dan"]):
        for trial in range(2):
            walk(folder / name / f"{trial}.parquet", "--steps", 2, scale=1 + 0.05 * index + 0.02 * trial)
    (folder / "ann" / "participant.toml").write_text("size = 37\nmass_kg = 61.5\nsex = 'female'\n")
    return folder
