"""The figures show the values of the tables."""

import pathlib

import matplotlib as mpl
import numpy as np
import pytest
from conftest import walk
from matplotlib.text import Text

import plantar
from plantar import plots

mpl.use("Agg")

pytestmark = pytest.mark.filterwarnings("ignore:parameters .* are not personal")


def test_a_foot_has_the_peak_pressure_of_each_cell(walk_file: pathlib.Path, tmp_path: pathlib.Path) -> None:
    recording = plantar.read(walk_file)
    figure = recording.plot()
    [squares] = figure.axes[0].collections
    peak_kpa = recording.to_pandas().max().to_numpy()
    np.testing.assert_array_equal(squares.get_array(), peak_kpa)
    assert squares.get_clim() == (0.0, peak_kpa.max())
    texts = {text.get_text() for text in figure.axes[0].texts}
    assert texts == {"heel", "posterior midfoot", "anterior midfoot", "metatarsals 1-2", "metatarsals 3-5", "hallux",
                     "toe 2", "toes 3-5"}
    figure.savefig(tmp_path / "foot.png")


@pytest.mark.parametrize("side", ["left", "right"])
def test_the_names_of_the_regions_do_not_overlap(
    tmp_path: pathlib.Path, side: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    recording = plantar.read(walk(tmp_path / "walk.parquet", "--steps", 1, "--side", side))
    cells = recording.cells
    # In some layouts, the centres of these two regions are on the same side of the foot, at the same distance from the heel.
    for region in ("hallux", "toe_2"):
        is_in_region = cells["region"] == region
        centre_mm = cells.loc[is_in_region, ["x_mm", "y_mm"]].mean()
        cells.loc[is_in_region, ["x_mm", "y_mm"]] += np.array([-20.0, 230.0]) - centre_mm
    monkeypatch.setattr(plantar.Recording, "cells", cells)
    figure = recording.plot()
    figure.canvas.draw()
    # `Text.get_window_extent` returns the extent of the name alone. That of the annotation would include the line to the region.
    names = [Text.get_window_extent(text) for text in figure.axes[0].texts]
    assert len(names) == 8
    for index, name in enumerate(names):
        assert not any(name.overlaps(other) for other in names[:index])


def test_places_are_spread_in_their_order_and_no_farther_than_necessary() -> None:
    spread = plots._spread(np.array([50.0, 0.0, 52.0, 9.0]), 9.0)
    np.testing.assert_allclose(spread, [46.5, 0.0, 55.5, 9.0])
    # Spreading the second and the third place moves the second one too close to the first one, so all three are placed around
    # their mean.
    np.testing.assert_allclose(plots._spread(np.array([0.0, 10.0, 10.0]), 9.0), [-7.0 / 3, 20.0 / 3, 47.0 / 3])
    np.testing.assert_array_equal(plots._spread(np.array([30.0, 10.0]), 9.0), [30.0, 10.0])


def test_a_missing_step_between_others_is_explained(walk_file: pathlib.Path) -> None:
    replay = plantar.replay(walk_file)
    # Step 3 is then missing, as if a load bout had this number.
    replay.steps = replay.steps.drop(index=3, level="step")
    with pytest.raises(ValueError, match="no step 3: the steps are 0 to 2, 4 to 5; the load bouts .* are no steps"):
        replay.plot(step=3)


def test_a_step_has_the_curves_of_its_regions(walk_file: pathlib.Path, tmp_path: pathlib.Path) -> None:
    replay = plantar.replay(walk_file)
    figure = replay.plot(step=2)
    assert [axes.get_title() for axes in figure.axes][:2] == ["heel", "posterior midfoot"]
    for axes, region in zip(figure.axes, plantar.REGIONS, strict=True):
        measured = np.asarray(axes.lines[0].get_ydata())
        peak_n = replay.steps.loc[(2, region), "measured_force_peak_n"]
        assert measured.max() == pytest.approx(peak_n, abs=0.06)
    with pytest.raises(ValueError, match="no step 99: the steps are 0 to 5$"):
        replay.plot(step=99)
    with pytest.raises(TypeError, match="step = '0': expected a whole number or None"):
        replay.plot("0")  # type: ignore[arg-type]
    figure.savefig(tmp_path / "step.png")


def test_the_pressure_of_the_steps_is_drawn_on_the_foot(walk_file: pathlib.Path, tmp_path: pathlib.Path) -> None:
    replay = plantar.replay(walk_file)
    figure = replay.plot_pressure()
    [squares] = figure.axes[0].collections
    np.testing.assert_array_equal(squares.get_array(), replay.cell_peaks_kpa.mean())
    assert figure.axes[0].get_title() == "Peak pressure, mean of 6 steps, right foot"
    figure.savefig(tmp_path / "mean.png")
    figure = replay.plot_pressure(step=2)
    [squares] = figure.axes[0].collections
    np.testing.assert_array_equal(squares.get_array(), replay.cell_peaks_kpa.loc[2])
    with pytest.raises(ValueError, match="no step 99: the steps are 0 to 5$"):
        replay.plot_pressure(step=99)


def test_a_fit_has_two_curves_for_each_step(walk_file: pathlib.Path, tmp_path: pathlib.Path) -> None:
    fit = plantar.fit(walk_file)
    figure = fit.plot()
    for axes, (_, row) in zip(figure.axes, fit.table().iterrows(), strict=True):
        assert len(axes.lines) == (2 * int(row["steps"]) if row["fitted"] else 0)
    figure.savefig(tmp_path / "fit.png")
