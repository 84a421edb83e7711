"""How figures are written: the same figure gives the same files, and bands have their spread."""

import numpy as np
import pytest
from matplotlib.figure import Figure

from pipeline.figures.style import COLOURS, draw_band, save_figure


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
