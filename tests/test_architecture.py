"""The packages are small, layered and without circles, and what passes between them is typed."""

import re
import tomllib
from collections import Counter
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
PACKAGES = ("hbm", "compensation", "pipeline")
MAX_MODULES = 16
FILES = {
    ".".join(path.relative_to(ROOT).with_suffix("").parts).removesuffix(".__init__"): path
    for package in PACKAGES
    for path in sorted((ROOT / package).rglob("*.py"))
}
MODULES = [name for name, path in FILES.items() if path.name != "__init__.py"]
FOLDERS = {name for name, path in FILES.items() if path.name == "__init__.py"}
CONTRACTS = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["tool"][
    "importlinter"
]["contracts"]


def folder(module: str) -> str:
    return ".".join(FILES[module].parent.relative_to(ROOT).parts)


def children(package: str) -> set[str]:
    """Names of the packages directly in a package."""
    return {name.rsplit(".", 1)[1] for name in FOLDERS if name.rpartition(".")[0] == package}


def test_every_module_of_pipeline_is_in_a_package():
    assert [name for name in MODULES if folder(name) == "pipeline"] == []


def test_no_folder_has_more_than_16_modules():
    sizes = Counter(map(folder, MODULES))
    assert {name: size for name, size in sizes.items() if size > MAX_MODULES} == {}


def test_every_package_of_pipeline_has_a_layer():
    (contract,) = [
        contract
        for contract in CONTRACTS
        if contract["type"] == "layers" and contract.get("containers") == ["pipeline"]
    ]
    layers = {name.strip() for layer in contract["layers"] for name in layer.split("|")}
    assert layers == children("pipeline")


def test_the_map_of_the_documentation_is_the_tree_of_packages():
    text = (ROOT / "docs" / "architecture.md").read_text(encoding="utf-8")
    tree = re.search(r"```text\n(.*?)```", text, re.DOTALL).group(1)
    shown, path = set(), []
    for indent, name in re.findall(r"^( *)(\w+)/ +\S", tree, re.MULTILINE):
        path = [*path[: len(indent) // 2], name]
        shown.add(".".join(path))
    assert {name for name in shown if name.split(".")[0] in PACKAGES} == FOLDERS
    for name in shown:
        assert (ROOT / name.replace(".", "/")).is_dir(), name
