"""The report has all result files, is a self-contained page, and accounts for every trial."""

import json
import re
from base64 import b64encode
from dataclasses import replace
from hashlib import sha256
from html import unescape
from html.parser import HTMLParser
from itertools import islice
from types import SimpleNamespace

import numpy as np
import pandas as pd
import pytest
from docx import Document

from pipeline.config.schema import Settings, StudyFile
from pipeline.report import write as report
from pipeline.report.trials import problems
from pipeline.report.write import write_report
from pipeline.run import provenance
from pipeline.run.provenance import TrialState
from pipeline.run.store import write_trial
from pipeline.statistics.measurement import CELL
from pipeline.trial.quality import Quality
from pipeline.trial.residuals import AXES
from tests.pipeline.browser import needs_chromium, open_browser
from tests.pipeline.fake_results import (
    fake_trial,
    standing,
    write_fake_results,
    write_fake_study,
)


class Page(HTMLParser):
    """Tags, attributes and text of a page."""

    def __init__(self, path):
        super().__init__()
        self.open, self.tags, self.attributes, self.text = [], [], [], ""
        self.source = path.read_text(encoding="utf-8")
        self.feed(self.source)
        self.text = " ".join(self.text.split())

    def handle_starttag(self, tag, attrs):
        self.tags.append(tag)
        self.attributes += attrs
        if tag not in ("meta", "img"):
            self.open.append(tag)

    def handle_endtag(self, tag):
        assert self.open.pop() == tag

    def handle_data(self, data):
        if not {"style", "script"} & {*self.open}:
            self.text += data


@pytest.fixture(scope="module")
def study(tmp_path_factory):
    folder = write_fake_study(tmp_path_factory.mktemp("study") / "study", subjects=4)
    subject = folder / "sub04.toml"
    text = subject.read_text().replace('file = "sub04_pitch.c3d"', 'exclude = "LPSI lost"')
    subject.write_text(text)
    (folder / "laboratory.html").write_text("")
    return folder


def large_errors(explained, residuals, weigh):
    """Errors of measurement of which tables have as much to show as of any."""
    return {axis: independent(own) for axis, own in residuals.groupby("axis")}, ""


def independent(values):
    """Covariance of errors of 40 % of each value."""
    cells = pd.MultiIndex.from_frame(values[[*CELL]])
    return pd.DataFrame(np.diag((0.4 * values["rms"].to_numpy()) ** 2), cells, cells)


@pytest.fixture(scope="module")
def folder(tmp_path_factory, study):
    """A report of four subjects, of whom one failed and one is excluded in one condition each."""
    folder = tmp_path_factory.mktemp("results")
    without = {("sub02", "sway"), ("sub04", "pitch")}
    write_fake_results(folder, subjects=4, cycles=3, without=without)
    failures = {"sub02 sway": "sub02_sway.c3d: marker <b>LHEE</b> & others are missing"}
    (folder / "failures.json").write_text(json.dumps(failures))
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("pipeline.report.write.study_covariances", large_errors)
        every = report.joint_figures
        patch.setattr(report, "joint_figures", lambda *given: islice(every(*given), 1))
        write_report(folder, study)
    return folder


@pytest.fixture(scope="module")
def page(folder):
    return Page(folder / "report.html")


@pytest.fixture
def unsaved(monkeypatch):
    """Leave figures empty: their appearance is not tested here."""
    monkeypatch.setattr(report, "save_figure", lambda *given: "data:image/svg+xml;base64,")


def test_the_page_is_well_formed_and_self_contained(page, folder):
    assert page.open == []
    assert "link" not in page.tags
    for name, value in page.attributes:
        if name in ("src", "href") and not value.startswith(("data:image/", "#")):
            assert name == "href"
            assert (folder / value).is_file(), value
        assert not name.startswith("on")
    assert "default-src 'none'" in page.source
    (script,) = re.findall("<script>(.*?)</script>", page.source, re.DOTALL)
    digest = b64encode(sha256(script.encode()).digest()).decode()
    assert f"script-src 'sha256-{digest}'" in page.source


def test_the_primary_analysis_comes_first_as_a_paper_has_it(page, folder):
    """Estimates with intervals, the F test, subjects, exclusions; the same in Word and LaTeX."""
    before = page.text[: page.text.index("Copy this paragraph")]
    assert re.search(r"F[\w ]*\([\d.]+, [\d.]+\) = [\d.]+, p [<=] \.\d{3}, ηp² = ", before)
    assert re.search(r"12 trials; .*sub02 sway \(failed\) .*sub04 pitch \(excluded\)", before)
    assert page.text.count("4 subjects are") == 1
    of_sway = re.search(r"In sway, (.*?)\. In ", before)[1]
    assert all(f"{axis} (" in of_sway for axis in AXES)
    paragraph = re.search('id="result">(.*?)</p>', page.source)[1]
    document = Document(str(folder / "results.docx"))
    assert unescape(paragraph) in [block.text for block in document.paragraphs]
    latex = (folder / "results.tex").read_text(encoding="utf-8")
    assert paragraph[:20] in latex
    assert not re.search(r"(?<!\$)[<>]|Table III|η|²", latex.replace(">{", ""))
    columns, share = re.search(r"\*\{(\d+)\}.*?p\{(.*?)\\linewidth", latex).groups()
    assert int(columns) * (float(share) + 2 * 0.004) <= 1
    assert latex.count(r"\label{tab:residuals-1}") == latex.count(r"\begin{sidewaystable}") == 1
    assert [section.page_width.mm for section in document.sections] == pytest.approx(
        [210, 297], abs=0.1
    )
    assert document.core_properties.author == ""
    captions = [b.text for b in document.paragraphs if b.style.name == "Caption"]
    assert captions[0].startswith("Table 1.")
    table = pd.read_csv(folder / "table_3.csv")
    assert len(document.tables[0].rows) == 1 + len(table)
    row = table[(table["axis"] == "Fy") & (table["condition"] == "sway")].iloc[0]
    cells = [cell.text for found in document.tables[0].rows for cell in found.cells]
    value = f"{row['mean_ic']:.1f} ± {row['sd_ic']:.1f}"
    assert any(cell.startswith(value) for cell in cells)
    assert value.replace("±", r"$\pm$") in latex


def test_table_3_on_the_page_is_that_on_disk(page, folder):
    table = pd.read_csv(folder / "table_3.csv")
    row = table[(table["axis"] == "Fy") & (table["condition"] == "sway")].iloc[0]
    for mean, sd in (("mean_no_ic", "sd_no_ic"), ("mean_ic", "sd_ic")):
        assert f"{row[mean]:.1f} ± {row[sd]:.1f}" in page.text
    assert "sway without sub02" in page.text
    assert "Table III." in page.text


def test_failed_and_excluded_trials_are_named_before_the_results(page):
    banner = page.text[: page.text.index("RMS without → with")]
    assert "2 of 12 trials" in banner
    assert re.search("sub02 sway failed: .*marker <b>LHEE</b> & others", banner)
    assert re.search("sub04 pitch .*LPSI lost", banner)
    assert "<b>" not in page.source


def test_trials_that_are_outdated_alike_are_one_line_and_every_missing_one_is_named():
    def states(state, in_tables):
        return [
            TrialState(f"{state}{k}", "sway", "", state, "why", in_tables, None, None)
            for k in range(9)
        ]

    source = SimpleNamespace(settings=[1], versions=[1], engines=[1])
    every = states("outdated", True) + states("failed", False)
    outdated, failed = problems(every, source, SimpleNamespace(trials={}), [])["lines"]
    assert "outdated0 sway" in outdated[0]
    assert "6 more" in outdated[0]
    assert all(f"failed{k} sway" in failed[0] for k in range(9))


def test_compensated_results_of_a_study_that_states_no_calibration_any_more_are_refused(tmp_path):
    study = SimpleNamespace(
        folder=tmp_path, file=StudyFile.model_validate({"conditions": {"a": {}, "b": {}}})
    )
    residuals = pd.DataFrame({"condition": ["a", "a"], "compensated": [False, True]})
    with pytest.raises(ValueError, match="--overwrite"):
        report._design(residuals, study)


def test_every_trial_shows_its_quality(page):
    assert "✔ 5.0 mm" in page.text
    assert re.search(r"▲ 1 of \d+", page.text)  # a frame without a solution
    assert "4.0 ± 1.0 ms" in page.text


def test_settings_versions_and_hashes_are_on_the_page_and_in_study_json(page, folder):
    stored = json.loads((folder / "study.json").read_text(encoding="utf-8"))
    for digest in (stored["program"]["sha256"], *stored["inputs"].values()):
        assert digest in page.text
    assert "Pinocchio 4.1.0" in page.text


def test_equal_results_give_an_equal_report_and_markup_in_a_name_is_text(
    tmp_path, undrawn, monkeypatch
):
    monkeypatch.setattr(provenance, "git_commit", lambda: "a commit")
    name = "<b>$x$\"'&"
    for condition in ("baseline", name):
        trial = replace(fake_trial(1, condition, cycles=2), condition=condition, key="key")
        write_trial(trial, tmp_path / "trials" / f"{len(condition)}.parquet")
    before = {}
    for _ in range(2):
        found = Page(write_report(tmp_path))
        files = {path: path.read_bytes() for path in tmp_path.glob("*.*")}
        assert before in ({}, files)
        before = files
    assert found.open == []
    assert "b" not in found.tags
    assert f"sub01 {name}" in found.text


@pytest.mark.parametrize(
    ("figures", "study", "text"),
    [
        (
            "unsaved",
            {"subjects": 1, "conditions": ("baseline", "sway")},
            "With one subject there are means, but no confidence intervals.",
        ),
        ("undrawn", {"subjects": 2, "compensated": False}, "There is no compensation to assess"),
        (
            "undrawn",
            {"subjects": 2, "conditions": ("baseline", "sway"), "without": {("sub01", "baseline")}},
            "sub01 baseline missing",
        ),
    ],
    ids=["one subject", "measured only", "gap"],
)
def test_incomplete_studies_are_reported_with_what_is_missing(
    tmp_path, request, figures, study, text
):
    request.getfixturevalue(figures)
    found = Page(write_report(write_fake_results(tmp_path, cycles=2, **study)))
    assert found.open == []
    assert text in found.text
    assert "Curves are not compared" in found.text
    assert "nan" not in re.sub(r"[a-z]+nan|nan[a-z]+", "", found.text.lower())


def test_a_study_without_compensation_speaks_of_none(tmp_path, undrawn):
    conditions = ("barefoot", "boots")
    write_fake_results(tmp_path, subjects=2, conditions=conditions, cycles=2, compensated=False)
    found = Page(write_report(tmp_path))
    assert not re.search(r"\bIC\b|Table III\. ", found.text)


def test_a_study_with_a_comparison_of_its_own_is_reported_by_it(tmp_path, undrawn):
    """Other conditions, one of them left out, groups, another reference, margin and correction."""
    names = {"baseline": "still", "sway": "tilt", "pitch": "shake"}
    folder = write_fake_study(tmp_path / "study", subjects=6)
    for number, path in enumerate(sorted(folder.glob("*.toml"))):
        text = path.read_text(encoding="utf-8")
        for old, new in names.items():
            text = text.replace(f".{old}]", f".{new}]")
        group = ("before", "after")[number % 2]
        text = f'group = "{group}"\n{text}' if path.stem != "study" else f"{text}\n{COMPARISON}"
        path.write_text(text, encoding="utf-8")
    write_fake_results(tmp_path, subjects=6, conditions=("still", "tilt", "shake"), cycles=2)
    found = Page(write_report(tmp_path, folder))
    question = "Is each residual with compensation not more than 10 % above still?"
    assert question in found.text
    assert found.text.count("Primary analysis:") == 1
    assert "at most 10 %" in found.text
    assert re.search("Holm-corrected .* 3 planned", found.text)
    assert "mixed ANOVA: IC × motion × group F(" in found.text
    residuals = pd.read_csv(tmp_path / "residuals.csv").query("headline and not compensated")
    own = residuals.query("axis == 'Fx' and condition == 'still' and subject in @BEFORE")["rms"]
    of_group = found.text[found.text.index("group before. RMS residuals") :]
    assert f"still 3 {own.mean():.1f} ± {own.std():.1f}" in of_group
    assert "calibration check empty.json" in found.text
    assert "Table III" not in found.text  # which is of the conditions of the thesis
    tests = pd.read_csv(tmp_path / "statistics.csv")
    assert {"mixed ANOVA", "mixed ANOVA with mass_kg"} <= set(tests["test"])
    assert tests["note"].iloc[-1].endswith(": tilt")


BEFORE = ("sub02", "sub04", "sub06")
COMPARISON = """
[comparison]
factor = "motion"
levels = ["shake", "still"]
reference = "still"
correction = "holm"
covariates = ["mass_kg"]
margin = 0.1
group = "group"
"""


def write_standing(folder, number, condition, **made):
    result = standing(fake_trial(number, condition, cycles=4, **made))
    path = folder / "trials" / f"sub{number:02}_{condition}.parquet"
    write_trial(replace(result, condition=condition, key="key"), path)


def test_a_study_of_standing_is_reported_over_the_recordings(tmp_path, unsaved):
    for number in (1, 2):
        write_standing(tmp_path, number, "quiet")
    found = Page(write_report(tmp_path))
    assert found.open == []
    assert "1.00–3.00 s" in found.text
    assert "2.0 s (quiet)" in found.text
    table = pd.read_csv(tmp_path / "residuals.csv")
    assert set(table["window"]) == {"span"}
    assert table["rms"].notna().all()


def test_what_is_unlike_the_other_trials_is_named_and_in_no_test(tmp_path, undrawn):
    """Spans among gait cycles, other settings, and a trial of which nothing counts."""
    conditions = ("baseline", "sway")
    absent = {("sub03", "sway"), ("sub02", "baseline")}
    write_fake_results(tmp_path, subjects=3, conditions=conditions, cycles=2, without=absent)
    write_standing(tmp_path, 3, "sway")
    lost = replace(
        standing(fake_trial(2, "baseline", cycles=2, settings=Settings(cutoff_hz=12))),
        shortage="the plates carry the subject in no frame",
        condition="baseline",
        key="key",
    )
    lost = replace(lost, quality=lost.quality | int(Quality.NOT_CARRIED))
    write_trial(lost, tmp_path / "trials" / "sub02_baseline.parquet")
    other = fake_trial(1, "sway", cycles=2, settings=Settings(cutoff_hz=12))
    other = replace(other, condition="sway", key="key")
    write_trial(other, tmp_path / "trials" / "sub01_sway.parquet")

    text = Page(write_report(tmp_path)).text
    assert re.search("sub03 sway: .*1.00 to 3.00 s", text)
    assert "sub02 baseline failed: " in text
    assert "2 different settings" in text
    tests = pd.read_csv(tmp_path / "statistics.csv")
    of_pair = tests["effect"].str.startswith("sway IC - sway no IC", na=False)
    sway = tests[of_pair & (tests["test"] != "mixed model")]
    assert (sway["n"] == 2).all()
    assert sway["note"].str.contains("without sub03").all()
    table = pd.read_csv(tmp_path / "residuals.csv")
    there = set(table[["subject", "condition"]].itertuples(index=False, name=None))
    assert ("sub03", "sway") in there
    assert ("sub02", "baseline") not in there


def test_the_page_links_to_that_of_the_laboratory_beside_the_calibration(page, folder, study):
    (link,) = (value for name, value in page.attributes if str(value).endswith("laboratory.html"))
    assert (folder / link).resolve() == (study / "laboratory.html").resolve()


def test_a_page_without_a_record_of_the_treadmill_says_which_command_writes_one(tmp_path, undrawn):
    write_fake_study(tmp_path / "study", subjects=1)
    (tmp_path / "study" / "empty.c3d").touch()
    file = tmp_path / "study" / "study.toml"
    file.write_text(file.read_text().replace("empty.json", "empty.c3d"))
    write_fake_results(tmp_path / "results", subjects=1, conditions=("baseline",), cycles=2)
    page = write_report(tmp_path / "results", tmp_path / "study").read_text(encoding="utf-8")
    assert re.search(r"<code>hbm calibration fit empty\.c3d .*</code>", page)


# In a real browser: drawn without errors or requests, readable on every screen


NEXT_FRAME = "new Promise(resolve => setTimeout(resolve, 100))"


@pytest.fixture(scope="module")
def browser(folder):
    with open_browser() as browser:
        browser.resize(1200)
        browser.open(folder / "report.html")
        yield browser


@needs_chromium
def test_the_page_raises_no_error_and_requests_nothing_but_itself(browser):
    assert browser.complaints == []
    assert [url for url in browser.requests if not url.startswith("data:")] == [
        url for url in browser.requests if re.fullmatch(r"file:.*report\.html", url)
    ]


@needs_chromium
def test_every_figure_is_drawn(browser):
    sizes = browser.evaluate("[...document.images].map(i => [i.complete, i.naturalWidth])")
    assert len(sizes) == 3 + 1  # of residuals and of joints
    assert all(complete and width > 500 for complete, width in sizes)


@needs_chromium
@pytest.mark.parametrize("width", [320, 1024, 1920])
def test_no_width_needs_horizontal_scrolling(browser, width):
    browser.resize(width)
    browser.evaluate("document.querySelectorAll('details').forEach(d => d.open = true)")
    assert browser.evaluate("document.documentElement.scrollWidth") <= width


@needs_chromium
def test_the_verdict_is_visible_without_scrolling(browser):
    browser.resize(1200, 900)
    browser.evaluate("document.querySelectorAll('details').forEach(d => d.open = false)")
    place = "document.getElementById('result').getBoundingClientRect()"
    assert browser.evaluate(f"{place}.bottom") < 900


@needs_chromium
def test_a_link_unfolds_its_section_and_the_button_copies_the_paragraph(browser):
    folded = "document.querySelector('#tests > details').open"
    browser.evaluate("document.querySelector('#tests > details').open = false")
    browser.evaluate("document.querySelector('nav a[href=\"#tests\"]').click()")
    browser.call("Runtime.evaluate", expression=NEXT_FRAME, awaitPromise=True)
    assert browser.evaluate(folded)
    browser.evaluate("document.querySelector('button[data-copy]').click()")
    selected = browser.evaluate("getSelection().toString()")
    assert selected == browser.evaluate("document.getElementById('result').innerText")


@needs_chromium
def test_text_has_enough_contrast(browser):
    """At least 4.5 : 1 for every text against its background (WCAG 2 AA)."""
    script = """[...document.querySelectorAll('p, span, td, th, a, caption, li, figcaption')]
      .filter(e => e.innerText && e.checkVisibility()).map(e => {
        let b = e; while (b && getComputedStyle(b).backgroundColor === 'rgba(0, 0, 0, 0)')
          b = b.parentElement;
        return getComputedStyle(e).color + '|' +
          (b ? getComputedStyle(b).backgroundColor : 'rgb(255, 255, 255)');
      })"""
    pairs = {tuple(pair.split("|")) for pair in browser.evaluate(script)}

    def luminance(colour):
        channels = [int(c) / 255 for c in re.findall(r"\d+", colour)[:3]]
        linear = [c / 12.92 if c <= 0.03928 else ((c + 0.055) / 1.055) ** 2.4 for c in channels]
        return 0.2126 * linear[0] + 0.7152 * linear[1] + 0.0722 * linear[2]

    assert len(pairs) > 4
    for text, ground in pairs:
        light, dark = sorted((luminance(text), luminance(ground)), reverse=True)
        assert (light + 0.05) / (dark + 0.05) >= 4.5, (text, ground)
