"""The same figure gives the same files, and its bands have the spread that they state."""

import numpy as np
import pytest
from matplotlib.figure import Figure

from pipeline.figures.style import COLOURS, PALETTE, draw_band, draw_differences, save_figure
from pipeline.statistics.curves import CurveDifference
from pipeline.viewer.plots import LARGEST_COLOURS
from pipeline.viewer.trial import SIDE_COLOURS, STATES


def figure():
    drawn = Figure(figsize=(3, 2), layout="constrained")
    x = np.linspace(0, 100, 5)
    draw_band(drawn.subplots(), x, x**2, np.full(5, 3.0), COLOURS["measured"], label="$\\frac")
    drawn.axes[0].set_title("$\\frac")
    return drawn


def test_a_band_reaches_one_spread_to_both_sides():
    (band,) = figure().axes[0].collections
    heights = band.get_paths()[0].vertices[:, 1]
    assert (heights.min(), heights.max()) == pytest.approx((-3, 10_003))


def test_equal_figures_give_equal_files(tmp_path):
    for name in ("a", "b"):
        save_figure(figure(), tmp_path / name)
    for suffix in (".svg", ".png"):
        a, b = (tmp_path / f"{name}{suffix}" for name in ("a", "b"))
        assert a.read_bytes() == b.read_bytes()


def test_letters_that_no_font_has_are_in_the_svg_and_nothing_is_said(tmp_path):
    drawn = figure()
    drawn.axes[0].set_title("\U000103a0 歩行")  # Old Persian, which fonts lack
    save_figure(drawn, tmp_path / "letters")  # warnings are errors
    assert "\U000103a0 歩行" in (tmp_path / "letters.svg").read_text(encoding="utf-8")


def test_a_dollar_sign_is_text_and_not_a_formula(tmp_path):
    save_figure(figure(), tmp_path / "dollar")
    assert "$\\frac" in (tmp_path / "dollar.svg").read_text(encoding="utf-8")


def test_a_part_of_a_single_percent_has_a_bar_outside_the_panel_and_p_is_beside_it():
    panel = figure().axes[0]
    draw_differences(panel, [CurveDifference(67, 67, 0.047), CurveDifference(99, 100, 0.03)])
    bars = [patch.get_extents().transformed(panel.transData.inverted()) for patch in panel.patches]
    assert [(bar.x0, bar.x1) for bar in bars] == [(66.5, 67.5), (98.5, 100)]
    top = panel.get_ylim()[1]
    assert all(bar.y0 > top for bar in bars)
    assert panel.get_title(loc="right") == "p = .030"


def test_the_colours_of_plates_as_measured_and_compensated_mean_nothing_else():
    """In figures and in the viewer."""
    others = {*PALETTE, *LARGEST_COLOURS, *SIDE_COLOURS.values(), *STATES.values()}
    assert not others & {*COLOURS.values()}
