"""A treadmill's calibration as text: one inertia model per plate, and its provenance."""

import json
from collections.abc import Mapping
from dataclasses import asdict, dataclass, field, fields
from types import MappingProxyType
from typing import Any, Final

import numpy as np

from compensation.inertia.model import InertiaModel, Setup

FORMAT: Final = "hbm-residuals inertia calibration"
VERSION: Final = 2
UNNAMED_FILTER_VERSION: Final = 1
"""Did not name its filter, which was always the zero-phase one, and stored warnings."""
MAX_REASON: Final = 120
"""Characters of what is wrong, which names what the file holds."""


@dataclass(frozen=True, slots=True)
class Calibration:
    """Inertia models of all plates of a treadmill.

    Attributes
    ----------
    plates
        Plate name -> its model; every model has a setup.
    provenance
        Origin of the models, for people: recording, its hash, date, program version, …

    Examples
    --------
    >>> import compensation, numpy as np
    >>> accelerations = np.random.default_rng(0).normal([0, 0, 9.81], 1.0, (600, 3))
    >>> wrench = accelerations @ np.hstack([-150 * np.eye(3), np.full((3, 3), 15.0)])
    >>> setup = compensation.Setup(("rear",), rate_hz=1000.0, cutoff_hz=20.0)
    >>> model = compensation.fit_inertia(accelerations, wrench, setup)
    >>> calibration = Calibration({"plate 1": model}, {"recording": "empty.c3d"})
    >>> from_json(to_json(calibration), setup).plates["plate 1"].samples
    600
    """

    plates: Mapping[str, InertiaModel]
    provenance: Mapping[str, str] = field(default_factory=dict)

    def __post_init__(self) -> None:
        if not self.plates:
            raise ValueError("a calibration needs the model of at least one plate")
        for name, model in self.plates.items():
            if model.setup is None:
                raise ValueError(
                    f"plate {name}: the model does not state how it was recorded; "
                    "give fit_inertia a setup"
                )
        for name in ("plates", "provenance"):
            object.__setattr__(self, name, MappingProxyType(dict(getattr(self, name))))


def to_json(calibration: Calibration) -> str:
    """Write a calibration as JSON text, from which `from_json` reads equal numbers.

    Examples
    --------
    >>> import compensation, numpy as np
    >>> accelerations = np.random.default_rng(0).normal([0, 0, 9.81], 1.0, (600, 3))
    >>> wrench = accelerations @ np.hstack([-150 * np.eye(3), np.full((3, 3), 15.0)])
    >>> setup = compensation.Setup(("rear",), rate_hz=1000.0, cutoff_hz=20.0)
    >>> model = compensation.fit_inertia(accelerations, wrench, setup)
    >>> to_json(Calibration({"plate 1": model})).splitlines()[1]
    ' "format": "hbm-residuals inertia calibration",'
    """
    document = {
        "format": FORMAT,
        "version": VERSION,
        "provenance": dict(calibration.provenance),
        "plates": {name: _plain(model) for name, model in calibration.plates.items()},
    }
    return json.dumps(document, indent=1, ensure_ascii=False, allow_nan=False)


def from_json(text: str, setup: Setup | None = None) -> Calibration:
    """Read a calibration from JSON text.

    Parameters
    ----------
    text
        Output of `to_json`.
    setup
        How the trial to be compensated was recorded; None not to compare it.

    Returns
    -------
    Calibration
        The models and their provenance.

    Raises
    ------
    ValueError
        Not JSON, not a calibration, of another version, damaged, or for other sensors, rates,
        filters or units than ``setup``.

    Examples
    --------
    >>> from_json("{}")
    Traceback (most recent call last):
        ...
    ValueError: the text is not a calibration: its format should be 'hbm-residuals inertia \
calibration'
    """
    try:
        document = json.loads(text)
    except (ValueError, RecursionError) as error:
        raise ValueError(f"the calibration is not JSON: {error}") from error
    if not isinstance(document, dict) or document.get("format") != FORMAT:
        raise ValueError(f"the text is not a calibration: its format should be {FORMAT!r}")
    if document.get("version") not in (UNNAMED_FILTER_VERSION, VERSION):
        raise ValueError(
            f"the calibration has version {document.get('version')}, this program reads "
            f"versions {UNNAMED_FILTER_VERSION} and {VERSION}; fit it again"
        )
    try:
        plates = {name: _model(plain) for name, plain in document["plates"].items()}
        calibration = Calibration(plates, document["provenance"])
    except (KeyError, TypeError, AttributeError, OverflowError) as error:
        reason = str(error)[:MAX_REASON]
        raise ValueError(f"the calibration is damaged: {reason}; fit it again") from error
    if setup is not None:
        for model in calibration.plates.values():
            model.require(setup)
    return calibration


def _plain(model: InertiaModel) -> dict[str, Any]:
    values = ((f.name, getattr(model, f.name)) for f in fields(model) if f.name != "setup")
    plain = {name: v.tolist() if isinstance(v, np.ndarray) else v for name, v in values}
    return plain | {"setup": asdict(model.setup) if model.setup is not None else None}


def _model(plain: dict[str, Any]) -> InertiaModel:
    known = {name: value for name, value in plain.items() if name != "warnings"}  # version 1
    return InertiaModel(**(known | {"setup": Setup(**plain["setup"])}))
