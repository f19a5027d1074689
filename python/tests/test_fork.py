"""Worker processes."""

import multiprocessing
import pathlib
import sys

import pytest

import plantar


def side(path: pathlib.Path) -> str:
    """Reads a recording, and returns its side, or the text of the error."""
    try:
        return plantar.read(path).side
    except RuntimeError as error:
        return str(error)


def side_in_process(method: str, path: pathlib.Path) -> str:
    """As `side`, in a process that is started with this method."""
    with multiprocessing.get_context(method).Pool(1) as pool:
        return pool.apply_async(side, (path,)).get(timeout=60)


@pytest.mark.skipif(sys.platform == "win32", reason="Windows has no fork")
@pytest.mark.filterwarnings("ignore:.*fork:DeprecationWarning")
def test_a_forked_process_raises_an_error_instead_of_waiting(walk_file: pathlib.Path) -> None:
    assert plantar.read(walk_file).side == "right"
    assert side_in_process("spawn", walk_file) == "right"
    error = side_in_process("fork", walk_file)
    assert "spawn" in error and "forkserver" in error
