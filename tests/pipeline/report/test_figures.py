"""The lines of a study's figures show the data, and every axis is labelled."""

import pickle
import re
from functools import partial
from itertools import combinations

import numpy as np
import pandas as pd
import pytest
from matplotlib.text import Text
from PIL import Image
from scipy import stats

from pipeline.cli.app import main
from pipeline.config.schema import FIGURE_FORMATS, Figures
from pipeline.figures.style import COLOURS, LINES, condition_style, save_figure
from pipeline.report.figures import (
    gait_cycle_figure,
    marginal_means_figure,
    rms_over_cycles,
    study_figures,
)
from pipeline.report.joints import JointMeans, joint_figures
from pipeline.report.write import write_report
from pipeline.run.load import Curves, collect
from pipeline.statistics.comparison import statistics
from pipeline.statistics.curves import CurveComparison
from pipeline.statistics.design import EXPERIMENT_3, unstated_design
from pipeline.trial.residuals import AXES
from tests.pipeline.fake_results import write_fake_results, write_fake_study

GROUPS = "sway_IC_-_sway_no_IC_people_with_a_long_name_-_people_with_one_that_is_longer"
MM_PER_INCH = 25.4
PT_PER_INCH = 72


@pytest.fixture(scope="module")
def results(tmp_path_factory):
    folder = write_fake_results(tmp_path_factory.mktemp("three"), subjects=3, cycles=4)
    return collect(folder, in_curves=lambda trial: True)


@pytest.fixture(scope="module")
def curves(results):
    return rms_over_cycles(Curves(results.folder / "cycles.parquet"), "cycle")


@pytest.fixture(scope="module")
def tests(results):
    return statistics(results.residuals, results.subjects)


@pytest.fixture(scope="module")
def every(results, curves, tests):
    """All figures of a study, to be drawn."""
    joints = JointMeans(Curves(results.folder / "joint_cycles.parquet"), "cycle")
    values = np.linspace(-1, 1, 101)
    p = np.where((values > -0.9) & (values < -0.6), 0.0123, 1.0)
    one = CurveComparison(values, values - 1, values + 1, p, (9,), 18)
    of_groups = CurveComparison(values, values - 1, values + 1, p, (5, 4), 18)
    groups = "sway IC - sway no IC: people with a long name - people with one that is longer"
    compared = {
        **{(a, f"{c} IC - baseline no IC"): one for a in AXES for c in ("sway", "pitch")},
        **{(f"hip_flexion_{c}", "sway IC - sway no IC"): one for c in ("moment", "power")},
        **{(f"hip_internal_rotation_{c}", groups): of_groups for c in ("angle", "moment")},
    }
    of_joints = joint_figures(joints, EXPERIMENT_3, compared)
    return dict([*study_figures(results, curves, tests, EXPERIMENT_3, compared), *of_joints])


def seen_texts(figure):
    """Texts that are drawn: those of ticks within the axes' limits, and all others."""
    figure.draw_without_rendering()
    texts = [*figure.texts, *(text for legend in figure.legends for text in legend.get_texts())]
    if figure.get_suptitle():
        texts.append(figure._suptitle)
    for panel in figure.axes:
        texts += [child for child in panel.get_children() if isinstance(child, Text)]
        for axis in filter(lambda axis: axis.get_visible(), (panel.xaxis, panel.yaxis)):
            low, high = sorted(axis.get_view_interval())
            ticks = axis.get_major_ticks()
            texts += [axis.label, *(t.label1 for t in ticks if low <= t.get_loc() <= high)]
    return [text for text in {id(text): text for text in texts}.values() if text.get_text().strip()]


def line(panel, label):
    return next(drawn for drawn in panel.get_lines() if drawn.get_label() == label)


@pytest.mark.parametrize("condition", ["sway", "pitch"])
@pytest.mark.parametrize("axis", AXES)
def test_the_quadratic_mean_of_a_subjects_curve_is_its_value_in_the_table(
    results, curves, condition, axis
):
    """Of pitch too, whose artefact changes sign from cycle to cycle and cancels in a mean."""
    cell = f"subject == 'sub01' and condition == '{condition}' and axis == '{axis}'"
    curve = curves.query(cell)
    for compensated, own in curve.groupby("compensated"):
        rms = results.residuals.query(cell).set_index("compensated")["rms"][compensated]
        assert np.sqrt(np.mean(own["value"] ** 2)) == pytest.approx(rms, rel=0.02)


def test_recordings_of_unlike_length_are_equal_where_the_study_says_so(results, tmp_path):
    """A recording of residual 1 with three cycles, and one of residual 7 with one."""
    every = Curves(results.folder / "cycles.parquet").read()
    one = every.query("subject == 'sub01' and condition == 'sway' and percent == 0")
    first = one.assign(recording="01", value=1.0).query("cycle == 1 and side == 'right'")
    cycles = pd.concat([*[first] * 3, first.assign(recording="02", value=7.0)])
    cycles.to_parquet(tmp_path / "cycles.parquet")
    for weigh, mean_square in (("cycle", 13.0), ("recording", 25.0)):
        over_cycles = rms_over_cycles(Curves(tmp_path / "cycles.parquet"), weigh)
        np.testing.assert_allclose(over_cycles["value"] ** 2, mean_square)


def test_a_gait_cycle_is_the_mean_and_sd_over_subjects(curves):
    cells = curves.query("condition == 'pitch' and compensated and axis == 'My'")
    by_subject = cells.pivot(index="subject", columns="percent", values="value").to_numpy()
    panel = gait_cycle_figure(curves, "pitch", EXPERIMENT_3).axes[AXES.index("My")]
    np.testing.assert_allclose(line(panel, "pitch IC").get_ydata(), by_subject.mean(axis=0))
    band = panel.collections[-1].get_paths()[0].vertices
    spread = by_subject.mean(axis=0) + by_subject.std(axis=0, ddof=1)
    assert band[:, 1].max() == pytest.approx(spread.max())


def test_colour_and_line_style_mean_compensation_and_thin_lines_the_reference(curves):
    """So that no two curves differ by colour alone."""
    panels = [gait_cycle_figure(curves, c, EXPERIMENT_3).axes[0] for c in ("sway", "pitch")]
    styles, widths = {}, {}
    for panel, condition in zip(panels, ("sway", "pitch"), strict=True):
        for name in ("baseline", condition):
            for label, variant in (("no IC", "measured"), ("IC", "compensated")):
                drawn = line(panel, f"{name} {label}")
                assert drawn.get_color() == COLOURS[variant]
                styles.setdefault(label, set()).add(drawn.get_linestyle())
                widths.setdefault(name, set()).add(drawn.get_linewidth())
    assert styles == {"no IC": {"--"}, "IC": {"-"}}
    (thin,), (wide,), others = widths["baseline"], widths["sway"], widths["pitch"]
    assert thin < wide
    assert others == {wide}
    looks = [condition_style(k) for k in range(25)]
    assert len(set(looks)) == 25
    assert not {colour for colour, _ in looks} & {*COLOURS.values()}


def test_a_study_without_compensation_does_not_speak_of_it(tmp_path):
    conditions = ("barefoot", "boots")
    folder = write_fake_results(
        tmp_path, subjects=2, conditions=conditions, cycles=3, compensated=False
    )
    own = collect(folder, in_curves=lambda trial: True)
    over_cycles = rms_over_cycles(Curves(folder / "cycles.parquet"), "cycle")
    design = unstated_design(conditions, compensated=False)
    tests = statistics(own.residuals, own.subjects, design)
    drawn = study_figures(own, over_cycles, tests, design, {})
    figures = {name: draw() for name, draw in drawn}
    shown = [text for figure in figures.values() for text in figure.findobj(Text)]
    assert not [text.get_text() for text in shown if "IC" in text.get_text()]
    lines = figures["gait_cycle_boots"].axes[0].get_lines()[:2]
    assert {drawn.get_label() for drawn in lines} == {*conditions}
    assert len({drawn.get_color() for drawn in lines}) == 2


def test_every_interval_ends_on_the_axis_or_at_its_lower_edge(results, tests):
    """Two subjects: intervals go far below zero, and no axis may cut off their upper ends."""
    two = results.residuals.query("subject != 'sub03'")
    for panel in marginal_means_figure(two, tests, EXPERIMENT_3).axes:
        low, high = panel.get_ylim()
        assert high >= low * 9.999  # what hardly differs looks so
        for _, _, (bars,) in panel.containers:
            ends = np.array(bars.get_segments())[:, :, 1]
            assert ends.max() <= high
            arrows = [
                x
                for drawn in panel.get_lines()
                if drawn.get_marker() == "v"
                for x in drawn.get_xdata()
            ]
            below = np.array(bars.get_segments())[ends.min(axis=1) < low, 0, 0]
            assert {*below} <= {*arrows}
            assert panel.get_yscale() == "log"


def test_marginal_means_have_confidence_intervals(results, tests):
    panel = marginal_means_figure(results.residuals, tests, EXPERIMENT_3).axes[AXES.index("Mz")]
    rms = results.residuals.query("axis == 'Mz' and compensated and condition == 'sway'")["rms"]
    points, _, (bars,) = panel.containers[1]
    assert points.get_ydata()[1] == pytest.approx(rms.mean())
    low, high = np.array(bars.get_segments())[1, :, 1]
    expected = stats.t.interval(0.95, len(rms) - 1, rms.mean(), stats.sem(rms))
    assert (low, high) == pytest.approx(expected)
    assert "interaction p" in panel.get_title(loc="right")


def test_marginal_means_are_over_the_same_subjects_in_all_cells(results, tests):
    incomplete = results.residuals.query("not (subject == 'sub03' and condition == 'sway')")
    figure = marginal_means_figure(incomplete, tests, EXPERIMENT_3)
    assert "2 subjects" in figure.get_suptitle()
    whole = incomplete.query("subject != 'sub03'")
    mean = whole.query("axis == 'Fx' and condition == 'baseline' and compensated")["rms"].mean()
    assert figure.axes[0].containers[1][0].get_ydata()[0] == pytest.approx(mean)


@pytest.mark.parametrize("width_mm", [None, 85.0, 180.0])
@pytest.mark.parametrize(
    "name",
    [
        "gait_cycle_sway",
        "difference_sway_IC_-_baseline_no_IC",
        "marginal_means",
        "joints_sway",
        "joints_difference_sway_IC_-_sway_no_IC",
        f"joints_difference_{GROUPS}",
        "upper_body",
    ],
)
def test_no_text_of_a_figure_covers_another_or_is_cut_off(every, name, width_mm):
    figure = every[name](look=Figures(width_mm=width_mm))
    boxes = {text: text.get_window_extent() for text in seen_texts(figure)}
    for text, box in boxes.items():
        if (lines := text.get_text()).endswith("\n"):  # for what is beside it
            box.y0 += box.height / (lines.count("\n") + 1)
    for text, box in boxes.items():
        assert figure.bbox.x0 <= box.x0 <= box.x1 <= figure.bbox.x1, text
        assert figure.bbox.y0 <= box.y0 <= box.y1 <= figure.bbox.y1, text
    for (first, a), (second, b) in combinations(boxes.items(), 2):
        assert not a.overlaps(b), (first, second)


@pytest.mark.parametrize("width_mm", [85.0, 180.0])
def test_every_file_is_as_wide_as_stated_in_mm_at_300_dpi_or_more(every, width_mm, tmp_path):
    look = Figures(width_mm=width_mm, formats=FIGURE_FORMATS)
    save_figure(every["marginal_means"](look=look), tmp_path / "means", look)
    for suffix in ("png", "tiff"):
        with Image.open(tmp_path / f"means.{suffix}") as image:
            dpi = float(image.info["dpi"][0])
            assert suffix == "png" or image.mode == "RGB"
            assert dpi == pytest.approx(300, abs=0.1)
            assert image.width / dpi * MM_PER_INCH == pytest.approx(width_mm, abs=0.1)
    page = re.search(rb"/MediaBox \[ ?0 0 ([\d.]+)", (tmp_path / "means.pdf").read_bytes())
    drawing = re.search(r'width="([\d.]+)pt"', (tmp_path / "means.svg").read_text("utf-8"))
    for found in (page, drawing):
        assert float(found[1]) / PT_PER_INCH * MM_PER_INCH == pytest.approx(width_mm, abs=0.1)


def test_every_figure_can_be_drawn_by_a_process_of_its_own(every):
    """What draws it reaches the process, and draws the same there."""
    sent = pickle.loads(pickle.dumps(every))
    assert [*sent] == [*every]
    title = sent["marginal_means"]().get_label()
    assert title == every["marginal_means"]().get_label()


def test_letters_have_the_stated_size_and_p_values_little_less(every):
    figure = every["joints_sway"](look=Figures(width_mm=180.0, font_pt=6.5))
    sizes = sorted({text.get_fontsize() for text in seen_texts(figure)})
    assert sizes == pytest.approx([0.833 * 6.5, 6.5])


def test_decimals_have_a_comma_where_stated_and_names_keep_their_points(every, tmp_path):
    for name in (f"joints_difference_{GROUPS}", "gait_cycle_sway", "marginal_means"):
        look = Figures(decimals="comma")
        figure = every[name](look=look)
        figure.axes[-1].set_xlabel("shoes 1.5")
        save_figure(figure, tmp_path / name, look)
        texts = {text.get_text() for text in seen_texts(figure)}
        assert [text for text in texts if re.search(r"\d\.\d|[=<] ?\.", text)] == ["shoes 1.5"]
        assert any(re.search(r"\d,\d", text) for text in texts)


def test_a_residuals_axis_has_its_unit_and_direction(every):
    labels = [panel.get_ylabel() for panel in every["gait_cycle_sway"]().axes]
    assert labels[0].split()[1:] == ["Fx", "(N),", "forward"]
    assert labels[4].split()[1:] == ["My", "(N·m),", "about", "right"]


def test_axes_of_joints_have_unit_sign_and_whose_moments_they_are(every):
    figure = every["joints_sway"]()
    first = [panel.get_ylabel() for panel in figure.axes if panel.get_ylabel()]
    assert first[1] == "internal\nmoment (N·m/kg)"
    assert figure.axes[0].get_title(loc="left").split() == ["hip", "flexion", "+"]


def test_in_one_column_forces_are_beside_moments(every):
    figure = every["gait_cycle_sway"](look=Figures(width_mm=85.0))
    labels = [panel.get_ylabel().split()[1] for panel in figure.axes]
    assert labels == ["Fx", "Mx", "Fy", "My", "Fz", "Mz"]
    places = np.array([panel.get_position().bounds for panel in figure.axes])
    np.testing.assert_allclose(places[::2, 1], places[1::2, 1])
    assert (places[::2, 0] < places[1::2, 0]).all()


@pytest.mark.parametrize(("variant", "name"), [("compensated", "IC"), ("measured", "no IC")])
def test_compensation_has_the_same_style_in_figures_of_residuals_of_joints_and_of_means(
    every, variant, name
):
    drawn = [line(every["joints_sway"]().axes[0], name)]
    drawn.append(line(every["gait_cycle_sway"]().axes[0], f"sway {name}"))
    means = every["marginal_means"]().axes[0].containers
    drawn += [points for points, *_ in means if points.get_color() == COLOURS[variant]]
    styles = {(one.get_color(), one.get_linestyle()) for one in drawn}
    assert styles == {(COLOURS[variant], LINES[variant])}


def test_what_a_figure_for_a_journal_has_no_title_for_is_its_label(every):
    figure = every["gait_cycle_sway"](look=Figures(width_mm=180.0))
    assert figure.get_suptitle() == ""
    assert "3 subjects" in figure.get_label()


def test_panels_of_joints_across_two_columns_are_wide_enough_to_be_read(every):
    figure = every["upper_body"](look=Figures(width_mm=180.0))
    figure.draw_without_rendering()
    width, height = figure.get_size_inches() * MM_PER_INCH
    for panel in figure.axes:
        place = panel.get_position()
        assert place.width * width > 30
        assert place.height * height > 12
    assert height <= 230


def test_means_of_one_series_stand_at_their_ticks(results, tests):
    measured = results.residuals.query("not compensated")
    panel = marginal_means_figure(measured, tests, EXPERIMENT_3).axes[0]
    assert panel.containers[0][0].get_xdata().tolist() == panel.get_xticks().tolist()


@pytest.mark.parametrize(
    ("typed", "written"), [((), {"pdf", "svg"}), (("tiff",), {"tiff"})], ids=["stated", "typed"]
)
def test_a_report_has_figures_in_the_stated_formats_alone_and_shows_them(
    results, tests, typed, written, tmp_path, undrawn, monkeypatch
):
    study = write_fake_study(tmp_path / "study", subjects=3)
    with (study / "study.toml").open("a", encoding="utf-8") as file:
        file.write('[figures]\nformats = ["pdf", "svg"]\n')
    draw = partial(marginal_means_figure, results.residuals, tests, EXPERIMENT_3)
    monkeypatch.setattr(
        "pipeline.report.write.study_figures", lambda *_: [("marginal_means", draw)]
    )
    out = write_fake_results(tmp_path / "results", subjects=1, conditions=("sway",), cycles=2)
    (out / "figures").mkdir()
    (out / "figures" / "marginal_means.png").write_bytes(b"of an earlier report")
    page = write_report(out, study, formats=typed)
    names = {path.name for path in (out / "figures").iterdir()}
    assert names == {f"marginal_means.{suffix}" for suffix in written}
    assert page.read_text(encoding="utf-8").count("data:image/svg+xml;base64,") == 1


@pytest.mark.parametrize(
    ("stated", "fault"),
    [
        ('formats = ["gif"]', "figures.formats.1: .*'pdf', 'svg', 'png' or 'tiff'"),
        ("width_mm = 8.5", "figures.width_mm: .* 80"),
        ("font_pt = 80", "figures.font_pt: .* 14"),
        ("dpi = 72", "figures.dpi: .* 300"),
        ('decimals = "coma"', "figures.decimals: .*'point' or 'comma'"),
    ],
)
def test_a_wrong_setting_of_figures_is_one_line(stated, fault, tmp_path, capsys):
    study = write_fake_study(tmp_path / "study", subjects=1)
    with (study / "study.toml").open("a", encoding="utf-8") as file:
        file.write(f"[figures]\n{stated}\n")
    assert main(["check", str(study)]) == 2
    (said,) = [one for one in capsys.readouterr().err.splitlines() if "figures." in one]
    assert re.search(fault, said)


def test_an_unknown_format_of_figures_is_refused_before_anything_is_read(tmp_path, capsys):
    assert main(["report", str(tmp_path), "--figures", "pdf,tif"]) == 2
    (said,) = capsys.readouterr().err.splitlines()
    assert "--figures tif: " in said
    assert "tiff" in said
