"""TOML files that a person wrote: read, and checked against the type of their contents."""

from pathlib import Path

from pydantic import ValidationError

from hbm.overrides import SegmentOverride, read_overrides
from hbm.spelling import Table, parse_toml
from pipeline.config.validation import Model, StudyFaults, describe_faults
from pipeline.io.input_file import naming, read_text


def read_table(path: Path) -> Table:
    """Read a TOML file; StudyFaults if it cannot be read, is not UTF-8 or not TOML."""
    try:
        return parse_toml(read_text(path))
    except UnicodeDecodeError as error:
        fault = f"is not saved as UTF-8: {error.reason} at byte {error.start}"
    except ValueError as error:
        fault = f"not valid TOML: {error}"
    except OSError as error:
        fault = f"cannot be read: {error.strerror}"
    raise StudyFaults([f"{path.name}: {fault}"])


def check_table(name: str, table: Table, kind: type[Model]) -> Model:
    """Check the contents of the file `name` against a type; StudyFaults holds all findings."""
    try:
        return kind.model_validate(table)
    except ValidationError as error:
        raise StudyFaults([f"{name}: {fault}" for fault in describe_faults(error, kind)]) from error


def read_segments(path: Path) -> dict[str, SegmentOverride]:
    """Read segment overrides from a TOML file; raises as `read_overrides`."""
    with naming(path):
        return read_overrides(read_text(path), path.name)
