"""The page of the dependencies, ``dependencies.md``: from pyproject.toml, metadata and reasons.

``python docs/dependencies_page.py`` writes it, where all that is optional is installed.
"""

import re
import tomllib
from collections.abc import Mapping
from importlib.metadata import PackageNotFoundError, metadata
from pathlib import Path

HERE = Path(__file__).parent
HEAD = """# Dependencies and licences

hbm-residuals is MIT: its files may be used, changed and passed on under those terms. pingouin,
which `hbm report` imports, is GPL-3: who passes on the whole together with it, as an installer or
image, has to do so under GPL-3. Without pingouin all but `hbm report` runs.

Licences are as the packages' metadata say (`python docs/dependencies_page.py`). No package is
copied into this one; pip installs each from its own source.
"""
REASONS: Mapping[str, tuple[str, str]] = {
    "pin": ("`body.model`; checks the kernels in tests", "the kernels, which run without"),
    "numpy": ("arrays", "–"),
    "scipy": ("filters, splines, optimisation, distributions", "–"),
    "casadi": ("writes the C of the kernels, runs them without a compiler", "SymPy, slower"),
    "pandas": ("tables", "Polars"),
    "pyarrow": ("Parquet files of results", "HDF5"),
    "pingouin": ("tests of repeated measures in the report", "statsmodels and 300 lines"),
    "statsmodels": ("analysis of variance of unbalanced designs", "own least squares"),
    "rerun-sdk": ("viewer", "a web page of our own"),
    "pydantic": ("checks study.toml and options", "cattrs"),
    "typer": ("command line", "argparse"),
    "rich": ("tables and progress in a terminal", "plain text"),
    "joblib": ("processes of a run", "concurrent.futures"),
    "threadpoolctl": ("one thread of linear algebra per process", "environment variables"),
    "jinja2": ("report and pages", "f-strings"),
    "matplotlib": ("figures", "–"),
    "pillow": ("pictures in the viewer; TIFF", "matplotlib alone"),
    "ezc3d": ("second reader of C3D files, in a process of its own", "c3d"),
    "pyxdf": ("XDF files", "own reader"),
    "tomli-w": ("writes corrected studies", "own writer"),
    "openpyxl": ("workbook of a study", "CSV files, which are there too"),
    "python-docx": ("report as a Word file", "LaTeX, which is there too"),
    "anyascii": ("letters of names in file names", "names without their letters"),
    "c3d": ("third reader of C3D files", "–"),
    "pytest": ("tests", "–"),
    "pytest-xdist": ("tests on all cores", "one core"),
    "hypothesis": ("tests with varied inputs", "–"),
    "ruff": ("style", "–"),
    "mypy": ("types", "pyright"),
    "pandas-stubs": ("types of pandas", "–"),
    "scipy-stubs": ("types of scipy", "–"),
    "import-linter": ("who imports whom", "a test"),
    "sphinx": ("site", "MkDocs"),
    "furo": ("its look", "another theme"),
    "myst-nb": ("pages and notebooks of the site", "–"),
    "jupytext": ("notebooks as Python files", "–"),
    "dask": ("runs on several machines", "SLURM job arrays"),
    "dask-jobqueue": ("Dask on SLURM", "SLURM job arrays"),
    "opensim": ("comparison in tests", "–"),
    "mujoco": ("comparison in tests", "–"),
    "pylsl": ("live streams", "Qualisys, which needs none"),
}
"""Package -> why it is there, what would replace it."""
UNSTATED = {"ezc3d": "MIT", "opensim": "Apache-2.0", "mujoco": "Apache-2.0"}
"""Where metadata say nothing, or what only tests use is not installed: the package's own file."""
SHORT = {
    "BSD License": "BSD-3-Clause",
    "BSD 2-Clause License": "BSD-2-Clause",
    "BSD 3-Clause": "BSD-3-Clause",
    "GNU Lesser General Public License v3 or later (LGPLv3+)": "LGPL-3.0-or-later",
    "GPL-3.0": "GPL-3.0-only",
    "ISC License (ISCL)": "ISC",
    "MIT": "MIT",
    "MIT License": "MIT",
    "Python Software Foundation License": "PSF-2.0",
}
"""What metadata say -> the letters of SPDX."""


def licence(name: str) -> str:
    """Give a package's licence by its metadata; nothing where it is not installed."""
    try:
        stated = metadata(name)
    except PackageNotFoundError:
        return UNSTATED.get(name, "")
    if expression := stated.get("License-Expression"):
        return str(expression)
    classes = [text.split(" :: ")[-1] for text in stated.get_all("Classifier", [])]
    texts = [(stated.get("License") or "").strip(), *classes]
    return next((SHORT[text] for text in texts if text in SHORT), UNSTATED.get(name, "unknown"))


def dependencies_page() -> str:
    """Give the page: a table of what is always installed, and one of each extra."""
    project = tomllib.loads((HERE.parent / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    extras = {f"Extra `{name}`": of for name, of in project["optional-dependencies"].items()}
    page = [HEAD]
    for title, requirements in ({"Always": project["dependencies"]} | extras).items():
        page.append(
            f"\n## {title}\n\n| package | licence | why | in its place |\n|---|---|---|---|\n"
        )
        for requirement in requirements:
            name = re.split(r"[^\w.-]", requirement)[0]
            page.append(f"| {name} | {licence(name)} | {' | '.join(REASONS[name])} |\n")
    return "".join(page)


if __name__ == "__main__":
    (HERE / "dependencies.md").write_text(dependencies_page(), encoding="utf-8")
