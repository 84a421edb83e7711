"""``hbm explain`` prints and stores what residuals are made of."""

import json
import re
from pathlib import Path

import pytest

from pipeline.cli.app import main
from pipeline.run.store import read_trial
from tests.pipeline import lab


def test_a_walk_is_explained_and_the_budget_stored(walker, tmp_path, capsys):
    walk = lab.save(lab.cropped(walker, 0, 900), tmp_path / "walk.c3d")
    assert main(["explain", str(walk), "--sex", "female", "--out", str(tmp_path)]) == 0
    said = " ".join(capsys.readouterr().out.split())
    assert "Held-out check: " in said
    stored = json.loads((tmp_path / "walk_explained.json").read_text())
    assert stored["budget"]["found_cycles"] >= 3
    assert (tmp_path / "walk_bands.parquet").stat().st_size > 0
    page = (tmp_path / "walk.html").read_text(encoding="utf-8")
    shown = re.search(f"hbm view ({re.escape(str(tmp_path))}.*) --at", page)
    assert read_trial(Path(shown[1])).condition == "walk"


@pytest.mark.parametrize(
    ("arguments", "words"),
    [(["gone.c3d"], "gone.c3d"), (["result.parquet"], "only the recording"), (["."], "no results")],
)
def test_what_cannot_be_explained_gives_one_line(tmp_path, monkeypatch, capsys, arguments, words):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "result.parquet").touch()
    assert main(["explain", *arguments]) == 2
    error = capsys.readouterr().err
    assert words in error
    assert error.count("\n") == 1
