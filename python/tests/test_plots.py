"""The figures show the values of the tables."""

import pathlib

import matplotlib as mpl
import numpy as np
import pytest

import plantar

mpl.use("Agg")

pytestmark = pytest.mark.filterwarnings("ignore:parameters .* are not personal")


def test_a_foot_has_the_peak_pressure_of_each_cell(walk_file: pathlib.Path, tmp_path: pathlib.Path) -> None:
    recording = plantar.read(walk_file)
    figure = recording.plot()
    [squares] = figure.axes[0].collections
    np.testing.assert_array_equal(squares.get_array(), recording.to_pandas().max().to_numpy())
    texts = {text.get_text() for text in figure.axes[0].texts}
    assert texts == {"heel", "posterior midfoot", "anterior midfoot", "metatarsals 1-2", "metatarsals 3-5", "hallux",
                     "toe 2", "toes 3-5"}
    figure.savefig(tmp_path / "foot.png")


def test_a_step_has_the_curves_of_its_regions(walk_file: pathlib.Path, tmp_path: pathlib.Path) -> None:
    replay = plantar.replay(walk_file)
    figure = replay.plot(step=2)
    assert [axes.get_title() for axes in figure.axes][:2] == ["heel", "posterior midfoot"]
    for axes, region in zip(figure.axes, plantar.REGIONS, strict=True):
        measured = np.asarray(axes.lines[0].get_ydata())
        peak_n = replay.steps.loc[(2, region), "measured_force_peak_n"]
        assert measured.max() == pytest.approx(peak_n, abs=0.06)
    with pytest.raises(ValueError, match="no step 99: the steps are 0 to 5"):
        replay.plot(step=99)
    figure.savefig(tmp_path / "step.png")


def test_a_fit_has_two_curves_for_each_step(walk_file: pathlib.Path, tmp_path: pathlib.Path) -> None:
    fit = plantar.fit(walk_file)
    figure = fit.plot()
    for axes, (_, row) in zip(figure.axes, fit.table().iterrows(), strict=True):
        assert len(axes.lines) == (2 * int(row["steps"]) if row["fitted"] else 0)
    figure.savefig(tmp_path / "fit.png")
