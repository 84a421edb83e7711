"""The packages are small, layered and without circles, and what passes between them is typed."""

import ast
import re
import tomllib
from collections import Counter, defaultdict
from pathlib import Path

import grimp
import pytest

ROOT = Path(__file__).resolve().parents[1]
PACKAGES = ("hbm", "compensation", "pipeline")
MAX_MODULES = 16
MAPPINGS = {"dict", "Mapping", "MutableMapping"}
ANYTHING = {"Any", "object"}
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


def test_every_package_of_pipeline_has_a_layer_which_the_documentation_shows():
    (contract,) = [
        contract
        for contract in CONTRACTS
        if contract["type"] == "layers" and contract.get("containers") == ["pipeline"]
    ]
    layers = {name.strip() for layer in contract["layers"] for name in layer.split("|")}
    assert layers == children("pipeline")
    text = (ROOT / "docs" / "architecture.md").read_text(encoding="utf-8")
    rows = [
        set(re.findall(r"`(\w+)`", row)) for row in re.findall(r"^\| \d+ \|(.*?)\|", text, re.M)
    ]
    assert rows == [set(layer.split(" | ")) for layer in contract["layers"]]


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


def test_no_modules_import_each_other_in_a_circle():
    """Imports for type checking included. Modules at either end of the arrows are dropped first."""
    graph = grimp.build_graph(*PACKAGES, cache_dir=None)
    imports = {name: graph.find_modules_directly_imported_by(name) for name in graph.modules}
    size = 0
    while size != (size := len(imports)):
        imported = set().union(*imports.values())
        imports = {
            name: targets & imports.keys()
            for name, targets in imports.items()
            if name in imported and targets & imports.keys()
        }
    assert sorted(imports) == []


def test_no_mapping_of_anything_passes_between_packages():
    """Neither as argument or result of a function nor as field of a type that others import."""
    trees = {name: ast.parse(path.read_text(encoding="utf-8")) for name, path in FILES.items()}
    imported = defaultdict(set)
    for name, tree in trees.items():
        for node in ast.walk(tree):
            if not (isinstance(node, ast.ImportFrom) and node.module in FILES):
                continue
            if folder(node.module) != folder(name):
                imported[node.module].update(alias.name for alias in node.names)
    assert [
        f"{module}:{annotation.lineno}: {ast.unparse(annotation)}"
        for module, names in sorted(imported.items())
        for node in trees[module].body
        if getattr(node, "name", None) in names
        for annotation in annotations(node)
        if has_untyped_mapping(annotation)
    ] == []


def annotations(node):
    """Annotations of a function's signature, or of a class's fields and public methods."""
    if isinstance(node, ast.FunctionDef):
        arguments = node.args
        own = [*arguments.posonlyargs, *arguments.args, *arguments.kwonlyargs]
        yield from (a.annotation for a in (*own, arguments.vararg, arguments.kwarg) if a)
        yield node.returns
    elif isinstance(node, ast.ClassDef):
        yield from (member.annotation for member in node.body if isinstance(member, ast.AnnAssign))
        for member in node.body:
            if not getattr(member, "name", "_").startswith("_"):
                yield from annotations(member)


def has_untyped_mapping(annotation):
    """Whether it holds a bare mapping, or one whose values are `Any` or `object`."""
    if isinstance(annotation, ast.Subscript) and name_of(annotation.value) in MAPPINGS:
        values = (
            annotation.slice.elts[-1] if isinstance(annotation.slice, ast.Tuple) else annotation
        )
        return any(name_of(node) in ANYTHING for node in ast.walk(values))
    if name_of(annotation) in MAPPINGS:
        return True
    return any(map(has_untyped_mapping, ast.iter_child_nodes(annotation or ast.Pass())))


def name_of(node):
    return getattr(node, "id", getattr(node, "attr", None))


@pytest.mark.parametrize(
    ("annotation", "untyped"),
    [
        ("dict[str, Any]", True),
        ("Mapping[str, object] | None", True),
        ("list[dict]", True),
        ("dict[str, tuple[Any, ...]]", True),
        ("Mapping[str, Mapping[str, float]]", False),
        ("Any", False),
    ],
)
def test_an_untyped_mapping_is_recognised(annotation, untyped):
    assert has_untyped_mapping(ast.parse(annotation, mode="eval").body) == untyped
