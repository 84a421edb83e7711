"""A laboratory's calibration as text: one inertia model per plate, and where they come from."""

import json
from collections.abc import Mapping
from dataclasses import asdict, dataclass, field, fields
from types import MappingProxyType
from typing import Any

import numpy as np

from compensation.inertia.model import InertiaModel, Setup

_FORMAT = "hbm-residuals inertia calibration"
_VERSION = 2
_UNNAMED_FILTER = 1
"""Last version that did not name its filter, which was always the zero-phase one."""


@dataclass(frozen=True, slots=True)
class Calibration:
    """Inertia models of all plates of a treadmill.

    Attributes
    ----------
    plates
        Plate name -> its model; every model has a setup.
    provenance
        Where the models come from, for a person: recording, its hash, date, program version, …
    """

    plates: Mapping[str, InertiaModel]
    provenance: Mapping[str, str] = field(default_factory=dict)

    def __post_init__(self) -> None:
        if not self.plates:
            raise ValueError("a calibration needs the model of at least one plate")
        for name, model in self.plates.items():
            if model.setup is None:
                raise ValueError(
                    f"plate {name}: the model does not say how it was recorded; "
                    "give fit_inertia a setup"
                )
        for name in ("plates", "provenance"):
            object.__setattr__(self, name, MappingProxyType(dict(getattr(self, name))))


def to_json(calibration: Calibration) -> str:
    """Write a calibration as JSON text; every number survives the round trip exactly."""
    document = {
        "format": _FORMAT,
        "version": _VERSION,
        "provenance": dict(calibration.provenance),
        "plates": {name: _plain(model) for name, model in calibration.plates.items()},
    }
    return json.dumps(document, indent=1, ensure_ascii=False, allow_nan=False)


def from_json(text: str, setup: Setup | None = None) -> Calibration:
    """Read a calibration from JSON text.

    Parameters
    ----------
    text
        What `to_json` wrote.
    setup
        How the trial was recorded that the calibration is meant for; None to read it for itself.

    Returns
    -------
    Calibration
        The models and their provenance.

    Raises
    ------
    ValueError
        Not JSON, not a calibration, of another version, damaged, or for other sensors, rates,
        filters or units than ``setup``.
    """
    try:
        document = json.loads(text)
    except json.JSONDecodeError as error:
        raise ValueError(f"the calibration is not JSON: {error}") from error
    if not isinstance(document, dict) or document.get("format") != _FORMAT:
        raise ValueError(f"the text is not a calibration: its format should be {_FORMAT!r}")
    if document.get("version") not in (_UNNAMED_FILTER, _VERSION):
        raise ValueError(
            f"the calibration has version {document.get('version')}, this program reads "
            f"versions {_UNNAMED_FILTER} and {_VERSION}; fit it again"
        )
    try:
        plates = {name: _model(plain) for name, plain in document["plates"].items()}
        calibration = Calibration(plates, document["provenance"])
    except (KeyError, TypeError, AttributeError) as error:
        raise ValueError(f"the calibration is damaged: {error}; fit it again") from error
    if setup is not None:
        for model in calibration.plates.values():
            model.require(setup)
    return calibration


def _plain(model: InertiaModel) -> dict[str, Any]:
    values = ((f.name, getattr(model, f.name)) for f in fields(model) if f.name != "setup")
    plain = {name: v.tolist() if isinstance(v, np.ndarray) else v for name, v in values}
    return plain | {"setup": asdict(model.setup) if model.setup is not None else None}


def _model(plain: dict[str, Any]) -> InertiaModel:
    known = {name: value for name, value in plain.items() if name != "warnings"}  # until 0.1
    return InertiaModel(**(known | {"setup": Setup(**plain["setup"])}))
