"""Settings, versions and input files on the page of a report."""

from dataclasses import dataclass
from typing import Final

from hbm.engines.engine import EngineUsed, title
from pipeline.report.tables import Table
from pipeline.run.provenance import Provenance

UNSTATED: Final = {
    "marker_set": "recognised from the files",
    "plate_delay_s": "that of the plates' calibration, where there is one, else 0.0",
    "events": "the file's where it has some, else auto",
    "engine": "pinocchio where it can be imported, else kernels",
}
"""Setting -> what it is where the study does not state it."""


@dataclass(frozen=True, slots=True)
class Sources:
    """What a study's results were made from.

    Attributes
    ----------
    tables
        Settings, versions and program.
    inputs
        Files of the study with their SHA-256; None without its folder.
    """

    tables: tuple[Table, ...]
    inputs: Table | None


def source_section(provenance: Provenance) -> Sources:
    """Show settings, versions and hashes.

    Parameters
    ----------
    provenance
        What the results were made from.

    Returns
    -------
    Sources
        Tables.
    """
    tables = []
    for settings in provenance.settings:
        stated = {k: UNSTATED[k] if v is None else str(v) for k, v in settings}
        tables.append(_pairs("Settings of the trials", ("Setting", "Value"), stated))
    package = ("Package", "Version")
    for versions in provenance.versions:
        tables.append(_pairs("The trials were processed with", package, dict(versions)))
    engines = tuple(_engine_row(engine) for engine in provenance.engines)
    columns = "Engine", "Checked by", "Frames", "Largest difference"
    tables.append(Table("Inverse dynamics of the trials", columns, engines))
    tables.append(_pairs("The report was made with", package, dict(provenance.report)))
    program = {
        "Source code, SHA-256": provenance.program.sha256,
        "Git commit": provenance.program.git_commit or "not in a repository",
    }
    tables.append(_pairs("The program", ("Program", "Identity"), program, "hashes"))
    inputs = None
    if provenance.inputs is not None:
        heads = ("File", "SHA-256")
        inputs = _pairs("Files of the study", heads, dict(provenance.inputs), "hashes")
    return Sources(tuple(tables), inputs)


def _engine_row(engine: EngineUsed) -> tuple[str, ...]:
    if engine.other is None:
        return str(engine), "not checked", "0", "unknown"
    other = title(engine.other, engine.other_version)
    return str(engine), other, str(engine.frames), f"{engine.difference:.0e}"


def _pairs(
    caption: str, heads: tuple[str, str], values: dict[str, str], css_class: str = ""
) -> Table:
    return Table(caption, heads, tuple(values.items()), css_class)
