"""The setting of a virtual laboratory in TOML: finding, reading, checking, writing."""

from importlib.resources import files
from pathlib import Path
from typing import Any, Final

from pydantic import BaseModel, ValidationError

from hbm.toml_text import parse_toml
from pipeline.config.toml_file import describe_faults
from pipeline.io.input_file import read_text
from pipeline.virtual_lab.protocol.walking_protocol import Setting

SHIPPED: Final = ("thesis",)
"""Names of the settings beside this module: what a thesis states of its laboratory."""


def find_setting(name: Path) -> Setting:
    """Read a setting from a file, or a shipped one by its name.

    Parameters
    ----------
    name
        A file or, where there is no such file, one of `SHIPPED`.

    Returns
    -------
    Setting
        Checked.

    Raises
    ------
    FileNotFoundError
        If there is neither.
    ValueError
        As `read_setting`.

    Examples
    --------
    >>> find_setting(Path("thesis")).faults.platform.delay_s
    0.03
    """
    if name.exists() or str(name) not in SHIPPED:
        return read_setting(read_text(name))
    return read_setting((files(__package__) / f"{name}.toml").read_text(encoding="utf-8"))


def read_setting(text: str) -> Setting:
    """Read a setting from TOML; what is not stated keeps its default.

    Parameters
    ----------
    text
        ``seed``, ``[protocol]``, and every fault in its table: ``[faults.machine]``,
        ``[faults.clocks]``, ``[faults.body]``, ``[faults.cameras]``, ``[faults.plates]``,
        ``[faults.accelerometers]``, ``[faults.belts]``, ``[faults.platform]``.

    Returns
    -------
    Setting
        Checked.

    Raises
    ------
    ValueError
        If the text is not TOML, or keys or values are wrong; all of them in one line.
    """
    try:
        table = parse_toml(text)
    except ValueError as error:
        raise ValueError(f"setting: not valid TOML: {error}") from error
    try:
        return Setting.model_validate(table)
    except ValidationError as error:
        raise ValueError("setting: " + "; ".join(describe_faults(error, Setting))) from error


def setting_toml(setting: Setting) -> str:
    """Write a setting as TOML, with every value."""
    return "\n".join(_lines("", setting))


def _lines(name: str, model: BaseModel) -> list[str]:
    values = {key: getattr(model, key) for key in type(model).model_fields}
    plain = {k: v for k, v in values.items() if not isinstance(v, BaseModel)}
    lines = [f"[{name}]"] if name and plain else []
    lines += [f"{key} = {_toml(value)}" for key, value in plain.items()]
    lines += [""] if plain else []
    for key, value in values.items():
        if isinstance(value, BaseModel):
            lines += _lines(f"{name}.{key}" if name else key, value)
    return lines


def _toml(value: Any) -> str:
    if isinstance(value, bool):
        return str(value).lower()
    if isinstance(value, str):
        return f'"{value}"'
    if isinstance(value, tuple):
        return f"[{', '.join(_toml(item) for item in value)}]"
    return repr(value)
