"""``import hbm_residuals as hr`` gives all that scripts call, under a name that nobody else has."""

import os
import pydoc
import re
import subprocess
import sys
from pathlib import Path
from types import ModuleType

import pytest

import hbm
import hbm_residuals as hr
import pipeline
from hbm.public_names import homes

ROOT = Path(__file__).resolve().parents[1]


def test_there_are_at_most_25_names_and_each_is_one_of_the_packages():
    assert len(dir(hr)) <= 25
    for name in dir(hr):
        found = getattr(hr, name)
        home = found.__name__ if isinstance(found, ModuleType) else found.__module__
        assert home.startswith("pipeline."), name
    assert hr.process is pipeline.process_recording
    assert hr.read is pipeline.read_recording


def test_help_is_one_screen_with_a_line_on_each_name():
    lines = pydoc.render_doc(hr, renderer=pydoc.plaintext).rstrip().split("\n")
    assert len(lines) <= 42
    assert max(map(len, lines[:-1])) <= 80  # the last is the path of the file
    items = " ".join(line.partition("  ")[0] for line in map(str.strip, lines))
    assert [name for name in dir(hr) if name not in re.findall(r"\w+", items)] == []


@pytest.mark.parametrize("package", [hbm, pipeline, hr], ids=lambda package: package.__name__)
def test_a_misspelt_name_is_an_error_and_the_right_ones_are_listed(package):
    assert set(dir(package)) == set(homes(package.__file__))
    with pytest.raises(AttributeError, match=rf"'{package.__name__}' .*'misspelt'"):
        package.misspelt  # noqa: B018


@pytest.mark.slow
def test_strict_type_checkers_know_every_public_name_and_no_other(tmp_path):
    """As a user's ``mypy --strict`` reads the installed packages."""
    packages = ("hbm", "compensation", "pipeline", "hbm_residuals")
    public = {name: tuple(homes(ROOT / name / "__init__.py")) for name in packages}
    public["compensation"] = ("fit_inertia", "fit_belt", "InertiaModel")
    lines = [f"import {', '.join(packages)}"]
    lines += [f"{package}.{name}" for package in packages for name in public[package]]
    lines += [f"{package}.misspelt" for package in packages]
    path = tmp_path / "script.py"
    path.write_text("\n".join(lines))
    command = [sys.executable, "-m", "mypy", "--strict", path]
    checked = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=False)
    errors = [line for line in checked.stdout.splitlines() if " error: " in line]
    assert len(errors) == len(packages), checked.stdout
    assert all('no attribute "misspelt"' in error for error in errors)


def script(tmp_path, code):
    """Run a script in a folder that has a file ``pipeline.py`` of its own."""
    (tmp_path / "pipeline.py").write_text("mine = True\n")
    (tmp_path / "script.py").write_text(code)
    return subprocess.run(
        [sys.executable, tmp_path / "script.py"],
        cwd=tmp_path,
        capture_output=True,
        text=True,
        env=os.environ | {"PYTHONPATH": str(ROOT)},
        check=False,
    )


def test_a_file_called_pipeline_beside_a_script_does_not_hide_the_package(tmp_path):
    assert script(tmp_path, "import pipeline; print(pipeline.mine)").stdout == "True\n"
    done = script(tmp_path, "import hbm_residuals as hr; print(hr.Subject(sex='male').sex)")
    assert (done.stdout, done.stderr) == ("male\n", "")


def test_processes_that_a_script_starts_find_the_package_too(tmp_path):
    code = """
import hbm_residuals as hr
from joblib import delayed
from pipeline.run.processes import in_processes
from pipeline.config.schema import Interval
if __name__ == "__main__":
    tasks = [delayed(Interval)(0.0, stop, "s") for stop in (1.0, 2.0)]
    print([span.stop for span in in_processes(tasks, 2, ordered=True)])
"""
    done = script(tmp_path, code)
    assert done.stdout == "[1.0, 2.0]\n", done.stderr


def test_a_file_called_pipeline_that_was_imported_before_is_named_in_the_error(tmp_path):
    done = script(tmp_path, "import pipeline, hbm_residuals")
    assert re.search(r"pipeline\.py .*'pipeline'", done.stderr.splitlines()[-1])
