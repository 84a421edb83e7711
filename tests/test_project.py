"""Versions, links, commands and texts of the project agree with each other."""

import ast
import re
import shlex
import shutil
import subprocess
import sys
import tomllib
from pathlib import Path

import pytest
import typer

from pipeline.cli.app import app

ROOT = Path(__file__).resolve().parents[1]
PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))
README = (ROOT / "README.md").read_text(encoding="utf-8")
CITATION = (ROOT / "CITATION.cff").read_text(encoding="utf-8")
PACKAGES = ("hbm", "compensation", "pipeline", "hbm_residuals")


def tracked_texts():
    """Every text file under version control."""
    if not shutil.which("git"):
        pytest.skip("git is not installed")
    listed = subprocess.run(
        ["git", "ls-files", "-z"], cwd=ROOT, capture_output=True, text=True, check=False
    )
    if listed.returncode:
        pytest.skip("not a git repository")
    for name in listed.stdout.split("\0"):
        path = ROOT / name
        if path.is_file():
            try:
                yield path, path.read_text(encoding="utf-8")
            except UnicodeDecodeError:
                continue


def test_importing_the_packages_loads_no_large_library():
    large = ("casadi", "matplotlib", "pandas", "pinocchio", "pingouin", "rerun")
    code = f"import sys, {', '.join(PACKAGES)}; print(*(m for m in {large!r} if m in sys.modules))"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == ""


def test_the_version_is_the_same_everywhere():
    version = PROJECT["project"]["version"]
    changes = (ROOT / "CHANGELOG.md").read_text(encoding="utf-8")
    unreleased, released = re.findall(r"^## (.+)$", changes, re.MULTILINE)[:2]
    assert unreleased == "[Unreleased]"
    stated, date = re.fullmatch(r"\[(.+)\] - (.+)", released).groups()
    assert stated == version
    assert f"\nversion: {version}\ndate-released: {date}\n" in CITATION


def shown_commands():
    """Every ``hbm`` command in a shell block of the README and of the docs, with its page."""
    for page in (ROOT / "README.md", *sorted((ROOT / "docs").glob("*.md"))):
        for block in re.findall(r"```sh\n(.*?)```", page.read_text(encoding="utf-8"), re.DOTALL):
            for line in re.findall(r"^hbm (.+)$", block, re.MULTILINE):
                words = shlex.split(line, comments=True)
                # a file alone is processed as a trial
                yield page.name, ["residuals", *words] if words[0].endswith(".c3d") else words


def test_commands_and_options_in_the_readme_and_the_docs_exist():
    shown = list(shown_commands())
    assert {"README.md", "recording.md", "treadmill.md", "study.md"} <= {page for page, _ in shown}
    for page, words in shown:
        line = f"{page}: {' '.join(words)}"
        command = typer.main.get_command(app)
        if "." in words[0]:  # a file: hbm FILE
            words.insert(0, "residuals")
        while hasattr(command, "list_commands"):
            assert words[0] in command.list_commands(None), line
            command = command.get_command(None, words.pop(0))
        known = {option for parameter in command.params for option in parameter.opts}
        assert {word for word in words if word.startswith("--")} <= known, line


def test_links_between_texts_lead_to_files_of_the_repository():
    """As GitHub shows them; pages of the API are made with the site."""
    link = re.compile(r"\]\((?!https?:|#|api/)([^)#\s]+)")
    texts = [(path, text) for path, text in tracked_texts() if path.suffix == ".md"]
    links = [(path, to) for path, text in texts for to in link.findall(text)]
    assert len(links) > 100
    assert [f"{path.name}: {to}" for path, to in links if not (path.parent / to).exists()] == []


def test_no_text_names_a_machine_or_an_index():
    """Paths of one machine and addresses of package indexes are useless elsewhere."""
    unwanted = re.compile("|".join(("/wor" + "k/", "/tm" + "p/", "/roo" + "t/", "pyp" + r"i\.org")))
    found = [
        f"{path.relative_to(ROOT)}: {hit.group()}"
        for path, text in tracked_texts()
        for hit in unwanted.finditer(text)
    ]
    assert found == []


SHOW_NOTES = {
    *("hbm/notes.py", "pipeline/cli/terminal.py", "pipeline/viewer/trial.py"),
    "pipeline/report/blocks.py",
}
"""They write notes for people."""


def reads_of_notes(text):
    """Lines that read a note's code, or its values by name; examples in docstrings are none."""
    for node in ast.walk(ast.parse(text)):
        match node:
            case ast.Attribute(value=ast.Name(id="self" | "error")):
                continue
            case (
                ast.Attribute(attr="code", ctx=ast.Load())
                | ast.Subscript(ast.Attribute(attr="values"), ast.Constant(str()))
                | ast.Attribute(ast.Attribute(attr="values"), "get" | "items" | "keys" | "values")
                | ast.Call(ast.Name("dict"), [ast.Attribute(attr="values")])
            ):
                yield node.lineno


def test_notes_are_written_for_people_and_no_code_decides_by_them():
    plain = "if note.code == 'legs_differ':\n    kg = notes[0].values['mass_kg']\n"
    assert [*reads_of_notes(plain)] == [1, 2]
    assert [*reads_of_notes("samples.values[:, 0]; table.values; 'note.code'")] == []
    found = {
        path.relative_to(ROOT).as_posix(): lines
        for package in PACKAGES
        for path in sorted((ROOT / package).rglob("*.py"))
        if (lines := [*reads_of_notes(path.read_text(encoding="utf-8"))])
    }
    assert {n: lines for n, lines in found.items() if n not in SHOW_NOTES} == {}


def test_type_checkers_find_the_packages_where_they_are_installed(tmp_path):
    """From another folder, after the README's `pip install -e .`; editors look in the same way."""
    command = [sys.executable, "-m", "mypy", "--follow-imports=skip", "--cache-dir", str(tmp_path)]
    imports = f"import {', '.join(PACKAGES)}"
    found = subprocess.run(
        [*command, "-c", imports], cwd=tmp_path, capture_output=True, text=True, check=False
    )
    assert found.returncode == 0, found.stdout


def test_each_file_of_tests_says_in_its_first_line_which_promise_it_holds():
    """In one sentence that a user could read."""
    wrong = []
    for path in sorted((ROOT / "tests").rglob("test_*.py")):
        first, *_ = (ast.get_docstring(ast.parse(path.read_text(encoding="utf-8"))) or "").split(
            "\n"
        )
        if not re.fullmatch(r"(?!Tests?\b).{20,}\.", first):
            wrong.append(f"{path.relative_to(ROOT)}: {first}")
    assert wrong == []
