"""The public names of a package, each imported when it is first used.

Importing a package then costs nothing, and each name stands in one place: the package's block for
type checkers, whose statements are what is done at run time too.
"""

import ast
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any


def homes(file: str | Path) -> Mapping[str, tuple[str, str]]:
    """Read the block ``if TYPE_CHECKING:`` of a file: public name -> its module, and name there.

    Its statements are ``from module import name as name`` and ``name = module.other_name``.
    """
    home: dict[str, tuple[str, str]] = {}
    for block in ast.parse(Path(file).read_text(encoding="utf-8")).body:
        for statement in block.body if isinstance(block, ast.If) else ():
            if isinstance(statement, ast.ImportFrom):
                home |= {
                    alias.name: (str(statement.module), alias.name) for alias in statement.names
                }
            elif isinstance(statement, ast.Assign):
                module, _, name = ast.unparse(statement.value).rpartition(".")
                home[ast.unparse(statement.targets[0])] = module, name
    return home


def on_first_use(
    package: str, file: str
) -> tuple[Callable[[str], Any], Callable[[], list[str]], list[str]]:
    """Give a package's ``__getattr__``, ``__dir__`` and ``__all__``, from its `homes`."""
    home = homes(file)
    names = sorted(home)

    def attribute(name: str) -> Any:
        if name not in home:
            raise AttributeError(f"module {package!r} has no attribute {name!r}")
        module, there = home[name]
        return getattr(__import__(module, fromlist=[there]), there)

    return attribute, lambda: names, names
