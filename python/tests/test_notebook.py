"""The notebook of the documentation runs."""

import pathlib

import nbclient
import nbformat

TOUR = pathlib.Path(__file__).parents[1] / "docs" / "tour.ipynb"


def test_the_notebook_runs_and_draws_its_figures(tmp_path: pathlib.Path) -> None:
    notebook = nbformat.read(TOUR, as_version=4)
    nbclient.NotebookClient(notebook, timeout=600, resources={"metadata": {"path": str(tmp_path)}}).execute()
    outputs = [output for cell in notebook.cells for output in cell.get("outputs", [])]
    assert sum("image/png" in output.get("data", {}) for output in outputs) == 3
    nbformat.write(notebook, tmp_path / "tour.ipynb")
