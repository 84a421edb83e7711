"""The report in a real browser: drawn without errors or requests, readable on every screen."""

import re

import numpy as np
import pandas as pd
import pytest

from pipeline.report.write import write_report
from pipeline.statistics.measurement import CELL
from tests.pipeline.browser import needs_chromium, open_browser
from tests.pipeline.fake_results import write_fake_results, write_fake_study

pytestmark = needs_chromium


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    folder = tmp_path_factory.mktemp("report")
    study = write_fake_study(folder / "study", subjects=3)
    results = folder / "results"
    write_fake_results(results, subjects=3, cycles=3, without={("sub02", "sway")})
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("pipeline.report.write.study_covariances", large_errors)
        write_report(results, study)
    return results


def large_errors(explained, residuals):
    """Errors of measurement of which tables have as much to show as of any."""
    return {axis: independent(own) for axis, own in residuals.groupby("axis")}, ""


def independent(values):
    """Covariance of errors of 40 % of each value."""
    cells = pd.MultiIndex.from_frame(values[[*CELL]])
    return pd.DataFrame(np.diag((0.4 * values["rms"].to_numpy()) ** 2), cells, cells)


@pytest.fixture(scope="module")
def browser(folder):
    with open_browser() as browser:
        browser.resize(1200)
        browser.open(folder / "report.html")
        yield browser


def test_the_page_raises_no_error_and_requests_nothing_but_itself(browser):
    assert browser.complaints == []
    assert [url for url in browser.requests if not url.startswith("data:")] == [
        url for url in browser.requests if re.fullmatch(r"file:.*report\.html", url)
    ]


def test_every_figure_is_drawn(browser):
    sizes = browser.evaluate("[...document.images].map(i => [i.complete, i.naturalWidth])")
    assert len(sizes) == 9
    assert all(complete and width > 500 for complete, width in sizes)


@pytest.mark.parametrize("width", [320, 1024, 1920])
def test_no_width_needs_horizontal_scrolling(browser, width):
    browser.resize(width)
    browser.evaluate("document.querySelectorAll('details').forEach(d => d.open = true)")
    assert browser.evaluate("document.documentElement.scrollWidth") <= width


def test_the_verdict_is_visible_without_scrolling(browser):
    browser.resize(1200, 900)
    place = "document.querySelector('.headline').getBoundingClientRect()"
    assert browser.evaluate(f"{place}.bottom") < 900
    text = browser.evaluate("document.querySelector('.headline').innerText")
    assert "3 subjects are a demonstration" in text


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
