"""The setting of a virtual laboratory in TOML: reading, checking, writing."""

from typing import Any

from pydantic import BaseModel, ValidationError

from hbm.toml_text import parse_toml
from pipeline.config.validation import describe_faults
from pipeline.virtual_lab.protocol.walking_protocol import Setting


def read_setting(text: str) -> Setting:
    """Read a setting from TOML; what is not stated keeps its default.

    Parameters
    ----------
    text
        ``seed``, ``[protocol]``, and every fault in its table: ``[faults.body]``,
        ``[faults.cameras]``, ``[faults.plates]``, ``[faults.accelerometers]``,
        ``[faults.platform]``.

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
