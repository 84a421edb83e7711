"""The plan states the subjects needed for every residual and condition, or is one line."""

import re

import pandas as pd

from pipeline.cli.app import main
from pipeline.report import write as report
from pipeline.report.tables import plan_markdown, plan_table
from pipeline.statistics.design import EXPERIMENT_3
from pipeline.statistics.verdict import Verdict


def verdict(condition="sway", answer="inconclusive", **known):
    usual = {"baseline": 40.0, "difference": 2.0, "sd": 5.0, "low": -4.0, "high": 9.0, "n": 9}
    return Verdict("Fx", "N", condition, answer, **usual | {"needed": 12} | known)


def test_every_comparison_has_its_number():
    found = [
        verdict(needed_as_observed=20),
        verdict("pitch", difference=30.0),
        verdict("baseline", needed=None),
    ]
    text = plan_markdown(found, EXPERIMENT_3)
    assert "| Residual | baseline | sway | pitch |" in text
    assert "| Fx | >1000 (>1000) | 12 (20) | 12 (–) |" in text
    table = plan_table(found, EXPERIMENT_3).set_index("condition")
    assert table.loc["sway", ["margin", "sd", "needed"]].tolist() == [8.0, 5.0, 12]
    assert pd.isna(table.loc["pitch", "needed_as_observed"])


def test_fewer_than_two_subjects_give_one_line():
    text = plan_markdown([verdict(answer="no interval", n=1, needed=None)], EXPERIMENT_3)
    assert re.match(r"No plan: .*\b2\b", text)


def test_the_command_prints_the_plan_of_the_report(tmp_path, monkeypatch, capsys):
    (tmp_path / "trials").mkdir()
    (tmp_path / "plan.md").write_text("| Residual | sway |\n", encoding="utf-8")
    monkeypatch.setattr(report, "write_report", lambda *given, **named: tmp_path / "report.html")
    assert main(["report", str(tmp_path), "--plan"]) == 0
    assert "| Residual | sway |\n" in capsys.readouterr().out
