"""Identity of the program: digests of its sources and libraries, and its commit."""

import hashlib
import subprocess
from collections.abc import Iterable
from functools import cache
from importlib.metadata import version
from pathlib import Path
from typing import Final

ROOT: Final = Path(__file__).resolve().parents[2]
PACKAGES: Final = ("hbm", "compensation", "pipeline")
COMPUTATION: Final = ("hbm", "compensation", "pipeline/io", "pipeline/config", "pipeline/trial")
"""Folders whose sources the numbers of a trial depend on."""


@cache
def computation_digest(root: Path = ROOT) -> str:
    """Give the SHA-256 of everything that computes a trial: sources and numerical libraries.

    Parameters
    ----------
    root
        Folder of the packages.

    Returns
    -------
    str
        Hexadecimal. Reports, figures, the viewer and the command line have no part in it.
    """
    digest = _sources(root, COMPUTATION)
    # libraries whose version may change the last bits of a result
    for name in ("numpy", "scipy", "casadi"):
        digest.update(f"{name} {version(name)}".encode())
    return digest.hexdigest()


@cache
def explanation_digest(root: Path = ROOT) -> str:
    """Give the SHA-256 of everything that explains the residuals of a processed trial."""
    # what explains a trial depends on these besides
    return _sources(root, ("pipeline/explain", "pipeline/budgets")).hexdigest()


@cache
def program_digest(root: Path = ROOT) -> str:
    """Give the SHA-256 of all sources of the program, reports and figures included."""
    return _sources(root, PACKAGES).hexdigest()


def _sources(root: Path, folders: Iterable[str]) -> "hashlib._Hash":
    digest = hashlib.sha256()
    for folder in folders:
        for path in sorted((root / folder).rglob("*")):
            if path.suffix in (".py", ".c", ".h", ".csv", ".toml", ".txt", ".html", ".css"):
                digest.update(path.relative_to(root).as_posix().encode())
                digest.update(path.read_bytes())
    return digest


def git_commit() -> str | None:
    """Give the commit of the program's sources, "… with changes" if they differ from it.

    None where the program does not run from a repository of its own.
    """
    if not (ROOT / ".git").exists():
        return None

    def git(*words: str) -> str:
        command = ["git", "-C", str(ROOT), *words]
        return subprocess.run(command, capture_output=True, text=True, check=True).stdout.strip()

    try:
        commit = git("rev-parse", "HEAD")
        changed = git("status", "--porcelain", "--", *PACKAGES)
    except (OSError, subprocess.CalledProcessError):
        return None
    return f"{commit} with changes" if changed else commit
