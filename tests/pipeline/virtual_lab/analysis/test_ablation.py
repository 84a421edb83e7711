"""What each fault adds: the table, its figure, and the commands that make them."""

import numpy as np
import pandas as pd
import pytest
from typer.testing import CliRunner

from pipeline.cli.app import app
from pipeline.virtual_lab.analysis.ablation import FILTER, ablation, cases
from pipeline.virtual_lab.analysis.ablation_figure import ablation_figure
from pipeline.virtual_lab.protocol.walking_protocol import ANALYSED_CONDITIONS, SHORT, Setting
from tests.pipeline.virtual_lab import conftest
from tests.virtual_gait.realism import realism_figure

SMALL = Setting(
    protocol=conftest.SHORT.model_copy(
        update={"baseline_s": 5.0, "pitch_s": 10.0, "waits_s": (12.0,)}
    )
)
ONE_EACH = (
    "zero phase, 30 Hz",
    "delay 10 ms",
    "delay 30 ms",
    "pivot error 5 cm",
    "no compensation, no other fault",
)


@pytest.fixture(scope="module")
def table():
    return ablation(SMALL, subjects=1, names=ONE_EACH)


def added(table, case, condition):
    own = table[(table["case"] == case) & (table["condition"] == condition)]
    return own.set_index("axis")["added"]


@pytest.mark.slow
def test_the_table_has_a_row_for_every_case_condition_and_axis(table):
    assert len(table) == len(ONE_EACH) * len(ANALYSED_CONDITIONS) * 6
    assert tuple(dict.fromkeys(table["case"])) == ONE_EACH
    assert np.isfinite(table["added"]).all()


@pytest.mark.slow
@pytest.mark.parametrize("condition", ANALYSED_CONDITIONS)
def test_a_perfect_laboratory_adds_nothing(table, condition):
    own = table[(table["case"] == "zero phase, 30 Hz") & (table["condition"] == condition)]
    assert (own["added"] == 0).all()
    assert (own["rms"] < 0.5).all()


@pytest.mark.slow
@pytest.mark.parametrize("condition", ANALYSED_CONDITIONS)
def test_what_a_delay_of_the_plates_adds_is_proportional_to_it(table, condition):
    """A small delay adds its duration times the rate of change of the load."""
    ratio = added(table, "delay 30 ms", condition) / added(table, "delay 10 ms", condition)
    np.testing.assert_allclose(ratio, 3, rtol=0.15)


@pytest.mark.slow
def test_faults_of_the_platform_add_nothing_where_it_does_not_move(table):
    assert added(table, "pivot error 5 cm", "baseline").max() < 1e-6
    assert added(table, "pivot error 5 cm", "pitch")["My"] > 2
    assert added(table, "no compensation, no other fault", "baseline").max() < 1e-6
    assert added(table, "no compensation, no other fault", "pitch")["Fx"] > 300
    assert added(table, "no compensation, no other fault", "sway")["Fy"] > 250


def test_cases_have_different_names_and_include_every_calibration_signal():
    names = [name for own in cases().values() for name in own]
    assert len(names) == len(set(names))
    assert len(cases()["compensation, calibrated on"]) == 14
    assert next(iter(cases())) == FILTER


def test_an_unknown_case_is_refused_and_the_nearest_is_suggested():
    with pytest.raises(ValueError, match=r"no case 'soft tissue skin'.*soft tissue: skin"):
        ablation(SMALL, names=("soft tissue skin",))


@pytest.mark.slow
def test_the_figure_shows_every_number_of_the_table(table):
    figure = ablation_figure(table, 1)
    panels = figure.axes
    assert [panel.get_title() for panel in panels] == list(ANALYSED_CONDITIONS)
    rows = [label.get_text() for label in panels[0].get_yticklabels()]
    assert set(ONE_EACH) < set(rows)
    for panel in panels:
        assert len(panel.texts) == len(ONE_EACH) * 6


@pytest.mark.slow
def test_one_command_writes_the_table_and_its_figure(tmp_path, monkeypatch, table):
    arguments = {}

    def quick(setting, subjects, progress, jobs):
        arguments.update(setting=setting, subjects=subjects, jobs=jobs)
        return table

    monkeypatch.setattr("pipeline.virtual_lab.analysis.ablation.ablation", quick)
    out = tmp_path / "out"
    done = CliRunner().invoke(app, ["simulate", str(out), "--ablation", "--seed", "4"])
    assert done.exit_code == 0, done.output
    assert arguments == {"setting": Setting(seed=4, protocol=SHORT), "subjects": 3, "jobs": 2}
    assert sorted(p.name for p in out.iterdir()) == ["ablation.csv", "ablation.png", "ablation.svg"]
    pd.testing.assert_frame_equal(
        pd.read_csv(out / "ablation.csv")[["case", "axis"]], table[["case", "axis"]]
    )


def test_a_setting_with_an_unknown_key_writes_nothing(tmp_path):
    path = tmp_path / "setting.toml"
    path.write_text("[faults.plates]\nnoise = 1.0", encoding="utf-8")
    done = CliRunner().invoke(app, ["simulate", str(tmp_path / "out"), "--setting", str(path)])
    assert done.exit_code != 0
    assert not (tmp_path / "out").exists()


def test_the_realism_figure_names_its_sources_even_without_their_data(monkeypatch, walked):
    walks = [walked(number)[0] for number in (0, 1)]
    monkeypatch.setattr("tests.virtual_gait.realism.simulated_walks", lambda *given: walks)
    figure = realism_figure(None, None, subjects=2)
    assert "Pinzone et al. 2014" in figure.get_supxlabel()
    assert "Moore, Hnat and van den Bogert 2015" in figure.get_supxlabel()
    assert sum(panel.axison for panel in figure.axes) == 11
