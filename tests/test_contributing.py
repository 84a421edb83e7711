"""What contributors are told holds: licences, reasons of dependencies, workflows, issue forms."""

import re
import runpy
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[1]
FORMS = sorted((ROOT / ".github" / "ISSUE_TEMPLATE").glob("[!c]*.yml"))


def test_each_dependency_has_its_licence_a_reason_and_a_replacement_on_the_page():
    made = runpy.run_path(str(ROOT / "docs" / "dependencies_page.py"))["dependencies_page"]()
    page = (ROOT / "docs" / "dependencies.md").read_text(encoding="utf-8")
    for row, written in zip(made.splitlines(), page.splitlines(), strict=True):
        # the licence of an extra that is not installed is not known here
        name, missing, rest = row.partition("|  |")
        assert written == row or (missing and written.startswith(name) and written.endswith(rest))


def test_the_workflow_runs_stages_that_exist():
    yaml = pytest.importorskip("yaml", reason="PyYAML, of the extra docs, is not there")
    stages = re.findall(r'^stage "([^"]+)"', (ROOT / ".ci" / "run").read_text("utf-8"), re.M)
    workflow = yaml.safe_load((ROOT / ".github" / "workflows" / "ci.yml").read_text("utf-8"))
    steps = [step.get("run", "") for job in workflow["jobs"].values() for step in job["steps"]]
    calls = [step for step in steps if step.startswith(".ci/run")]
    assert ".ci/run" in calls  # all stages, on one system
    assert {stage for call in calls for stage in re.findall(r'"([^"]+)"', call)} <= set(stages)


@pytest.mark.parametrize("path", FORMS, ids=lambda path: path.stem)
def test_an_issue_form_asks_for_what_shows_the_fault(path):
    yaml = pytest.importorskip("yaml", reason="PyYAML, of the extra docs, is not there")
    fields = {field["id"]: field for field in yaml.safe_load(path.read_text("utf-8"))["body"]}
    labels = {field["attributes"]["label"] for field in fields.values()}
    assert path.stem == "idea" or {"hbm doctor", "hbm FILE --header"} <= labels


def test_good_first_issues_name_a_place_in_the_code_and_a_test():
    text = (ROOT / "CONTRIBUTING.md").read_text(encoding="utf-8")
    rows = re.findall(r"^\d+\. .+$", text.partition("## Good first issues")[2], re.MULTILINE)
    assert rows
    for row in rows:
        paths = re.findall(r"`((?:hbm|compensation|pipeline|tests|docs)/[\w/.]+)`", row)
        assert any(path.startswith("tests/") for path in paths), row
        assert len(paths) > 1, row
        assert [path for path in paths if not (ROOT / path).exists()] == [], row
