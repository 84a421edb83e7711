"""The site: these pages, the API from its docstrings, and the notebooks as they run.

``python -m sphinx -W docs build/site``. Building needs no network, and the pages request nothing
from other servers.
"""

import ast
import json
import os
import re
import shutil
import tomllib
from importlib import import_module
from itertools import groupby
from operator import itemgetter
from pathlib import Path

from sphinx.application import Sphinx

from pipeline.config.input_model import bounds_of
from pipeline.config.schema import Settings
from pipeline.explain.cause import priors

DOCS = Path(__file__).resolve().parent
ROOT = DOCS.parent
PACKAGES = ("hbm", "compensation", "pipeline")
PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]

project = PROJECT["name"]
version = release = PROJECT["version"]
extensions = ["myst_nb", "sphinx.ext.autodoc", "sphinx.ext.napoleon"]
exclude_patterns = ["*.py", "api/priors.md", "api/settings.md"]  # those of api/ are included

html_theme = "furo"
html_title = f"{project} {version}"
html_show_sphinx = False
html_show_copyright = False
html_copy_source = False
html_static_path = html_css_files = ["site.css"]

default_role = "py:obj"
autodoc_member_order = "bysource"
autodoc_typehints_format = "short"
napoleon_google_docstring = False
napoleon_use_rtype = False
napoleon_attr_annotations = False

myst_heading_anchors = 3
nb_custom_formats = {".py": ["jupytext.reads", {"fmt": "py:percent"}]}
nb_execution_in_temp = True
nb_execution_mode = "force"
nb_execution_raise_on_error = True
nb_execution_timeout = 900
os.environ.pop("MPLBACKEND", None)  # each figure appears under its cell


def setup(app: Sphinx) -> None:
    """Collect what the pages take from outside this folder, and adapt it."""
    shutil.copytree(ROOT / "notebooks", DOCS / "notebooks", dirs_exist_ok=True)
    shutil.rmtree(DOCS / "laboratory", ignore_errors=True)
    shutil.copytree(ROOT / "tests/validation", DOCS / "laboratory", ignore=_no_notebook)
    (DOCS / "api").mkdir(exist_ok=True)
    for name, page in {**{p: _public_names(p) for p in PACKAGES}, "modules": _modules()}.items():
        (DOCS / "api" / f"{name}.md").write_text(page, encoding="utf-8")
    (DOCS / "api" / "priors.md").write_text(_priors(), encoding="utf-8")
    (DOCS / "api" / "settings.md").write_text(_settings_table(), encoding="utf-8")
    app.connect("include-read", _lead_links_to_the_root)
    app.connect("source-read", _lead_links_to_notebooks)
    app.connect("autodoc-process-signature", _shorten_arrays)


def _settings_table() -> str:
    """Give the settings as a table: key, default, allowed values, meaning."""
    lines = ["| key | default | allowed | meaning |", "|---|---|---|---|"]
    for name, field in Settings.model_json_schema()["properties"].items():
        stated = field["anyOf"][0] if "anyOf" in field else field
        allowed = ", ".join(stated.get("enum", ())) or bounds_of(Settings, name)
        meaning = " ".join(field["description"].split())
        default = "" if field["default"] is None else f"`{json.dumps(field['default'])}`"
        lines.append(f"| `{name}` | {default} | {allowed} | {meaning} |")
    return "\n".join(lines) + "\n"


def _public_names(package: str) -> str:
    """Document the public names of a package, by the modules that define them."""
    init = ROOT / package / "__init__.py"
    lines = [f"# {package}", "", _title(init)]
    exports = [
        (str(node.module), alias.name)
        for node in ast.walk(ast.parse(init.read_text(encoding="utf-8")))
        if isinstance(node, ast.ImportFrom)
        for alias in node.names
        if alias.asname and str(node.module).startswith(f"{package}.")
    ]
    for module, names in groupby(exports, key=itemgetter(0)):
        path = (ROOT / module.replace(".", "/")).with_suffix(".py")
        lines += ["", f"## {module}", "", _title(path), "", "```{eval-rst}"]
        for _, name in names:
            public = getattr(import_module(package), name)
            if isinstance(public, type):
                lines += [f".. autoclass:: {package}.{name}", "   :members:"]
            elif callable(public):
                lines += [f".. autofunction:: {package}.{name}"]
            else:
                lines += [f".. autodata:: {module}.{name}", "   :no-value:"]
        lines += ["```"]
    return "\n".join(lines) + "\n"


def _modules() -> str:
    """List all modules by package, each with the first line of its docstring."""
    lines = ["# All modules"]
    for package in PACKAGES:
        for init in sorted((ROOT / package).rglob("__init__.py")):
            lines += ["", f"## {'.'.join(init.parent.relative_to(ROOT).parts)}", "", _title(init)]
            paths = [path for path in sorted(init.parent.glob("*.py")) if path.stem[0] != "_"]
            rows = [f"| `{path.stem}` | {_title(path)} |" for path in paths]
            lines += ["", "| module | |", "|---|---|", *rows] if rows else []
    return "\n".join(lines) + "\n"


def _priors() -> str:
    """List how large each cause of residuals usually is, with the source."""
    rows = [
        f"| {kind.replace('_', ' ')} | {prior.mean:g} ± {prior.size:g} | {prior.unit} "
        f"| {prior.source} | {prior.advice} |"
        for kind, prior in priors().items()
    ]
    heads = ["| cause | mean ± SD | unit | source | to know it better |", "|---|---|---|---|---|"]
    return "\n".join([*heads, *rows]) + "\n"


def _title(path: Path) -> str:
    docstring = ast.get_docstring(ast.parse(path.read_text(encoding="utf-8"))) or ""
    return docstring.partition("\n")[0].replace("``", "`")


def _no_notebook(_: str, names: list[str]) -> list[str]:
    """Leave out what is no laboratory notebook, nor a table or figure of one."""
    return [name for name in names if Path(name).suffix not in {".md", ".csv", ".svg"}]


def _lead_links_to_notebooks(_: Sphinx, page: str, content: list[str]) -> None:
    """Let links to notebooks lead to the pages that are made of them."""
    text = content[0].replace("](../tests/validation/", "](laboratory/")
    content[0] = text.replace("](../notebooks/", "](notebooks/")


def _lead_links_to_the_root(_: Sphinx, path: Path, parent: str, content: list[str]) -> None:
    """Let links in an included file lead where they do in the repository."""
    text = content[0].replace("](../tests/validation/", "](laboratory/")
    if path.parent == Path(".."):
        text = re.sub(
            r"\]\((CHANGELOG|CODE_OF_CONDUCT|CONTRIBUTING)", lambda link: link[0].lower(), text
        )
        text = text.replace("](subjects/README.md", "](subjects.md")
        text = text.replace("](tests/validation/", "](laboratory/").replace("](docs/", "](")
        text = re.sub(r"\]\((?!https?:|#|notebooks/|laboratory/|[a-z0-9_]+\.[a-z])", "](../", text)
    content[0] = text


def _shorten_arrays(*event: object) -> tuple[str | None, ...]:
    """Write the types of arrays as `Array`, as the code does, in signature and result."""
    return tuple(
        re.sub(r"~numpy\.ndarray\[.*?\]\]", "Array", text) if isinstance(text, str) else None
        for text in event[-2:]
    )
