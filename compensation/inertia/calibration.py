"""A treadmill's calibration as text: one inertia model per plate, and its provenance."""

from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, field, fields
from types import MappingProxyType
from typing import Any, Final, TypeVar

import numpy as np
import scipy

from compensation.documents import damaged, read_document, write_document
from compensation.inertia.model import InertiaModel, Setup
from compensation.inertia.model_error import ModelError
from compensation.inertia.quality import MIN_LOAD_N, LeftOver, left_over
from compensation.inertia.sensors import Sensor
from hbm.notes import Note
from hbm.spatial import Array, read_only

OF: Final = "inertia"
AGAIN: Final = "fit it again with 'hbm calibration fit'"
VERSION: Final = 7
RELEASED: Final = 2
"""Version of 0.2.0: static models alone, which know of noise alone and are not judged, and no
delays of the accelerometers, whose readings are then used as they are."""
UNKNOWN_THEN: Final[Mapping[str, Any]] = {
    "model_error": None,
    "correlation": np.eye(6),
    "rms_slow": None,
    "lags_s": (),
}
Made = TypeVar("Made", InertiaModel, ModelError, Setup, Sensor)


@dataclass(frozen=True, slots=True)
class Calibration:
    """Inertia models of all plates of a treadmill.

    Attributes
    ----------
    plates
        Plate name -> its static model; every model has a setup.
    provenance
        Origin of the models, for people: recording, its hash, date, program version, …
    sensors
        The accelerometers with their delays, which were undone before the fit and have to be
        in every trial; empty where they were used as they are.
    correlation
        Of what is left below 6 Hz between the components of all plates, in the order of `plates`,
        (6 P, 6 P); None where it is unknown: the plates then count as independent.
    dynamic
        Plate name -> the dynamic model that compensates trials; empty where the static one does.

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
    sensors: tuple[Sensor, ...] = ()
    correlation: Array | None = None
    dynamic: Mapping[str, InertiaModel] = field(default_factory=dict)

    def __post_init__(self) -> None:
        if not self.plates:
            raise ValueError("a calibration needs the model of at least one plate")
        if self.dynamic and self.dynamic.keys() != self.plates.keys():
            raise ValueError("a calibration needs a dynamic model of every plate, or of none")
        if len({model.lags_s for model in self.dynamic.values()}) > 1:
            raise ValueError("the dynamic models of a calibration need the same lags")
        for name, model in (*self.plates.items(), *self.dynamic.items()):
            if model.setup is None:
                raise ValueError(
                    f"plate {name}: the model has no set-up of its recording; give fit_inertia one"
                )
            if self.sensors and model.sensors != tuple(sensor.name for sensor in self.sensors):
                raise ValueError(f"plate {name}: its accelerometers are not those described")
        for name in ("plates", "provenance", "dynamic"):
            object.__setattr__(self, name, MappingProxyType(dict(getattr(self, name))))
        if self.correlation is not None:
            correlation, size = read_only(self.correlation), 6 * len(self.plates)
            if correlation.shape != (size, size) or not np.isfinite(correlation).all():
                raise ValueError(
                    f"calibration: correlation must be numbers of shape {(size, size)}, "
                    f"got shape {correlation.shape}"
                )
            object.__setattr__(self, "correlation", correlation)

    @property
    def in_use(self) -> Mapping[str, InertiaModel]:
        """Plate name -> the model that compensates trials."""
        return self.dynamic or self.plates

    @property
    def verdict(self) -> dict[str, tuple[LeftOver, ...]]:
        """Plate -> what its model leaves of each component, beside its limit.

        Empty of a file of version 2, which does not say what is left below 6 Hz.
        """
        if any(model.model_error is None for model in self.in_use.values()):
            return {}
        return {name: left_over(model) for name, model in self.in_use.items()}

    @property
    def loads_n(self) -> dict[str, float]:
        """Plate -> mean force on it, of the plates that were loaded or not zeroed [N]."""
        loads_n = {}
        for name, model in self.in_use.items():
            # the model at the mean acceleration is the mean wrench: of an empty plate next to 0
            k = len(model.acceleration_mean)  # differences have no mean
            mean = model.acceleration_mean @ model.gain[:k, :3] + model.gain[-1, :3]
            if (force_n := float(np.linalg.norm(mean))) > MIN_LOAD_N:
                loads_n[name] = force_n
        return loads_n

    @property
    def notes(self) -> tuple[Note, ...]:
        """What to know wherever it is used: plates that were loaded, and the verdict."""
        notes = []
        if self.loads_n:
            notes.append(Note.of("calibration_loaded", force_n=self.loads_n))
        beyond = [
            f"{plate} {row.component} {row.left:.1f} {row.unit} (limit {row.limit:.1f})"
            for plate, rows in self.verdict.items()
            for row in rows
            if not row.passed
        ]
        if beyond:
            notes.append(Note.of("calibration_leaves_much", left=beyond))
        if not self.verdict:
            notes.append(Note.of("calibration_of_earlier_version"))
        return tuple(notes)

    def correlation_of(self, plates: Sequence[str]) -> Array:
        """Give the correlation of what is left of some plates, (6 P, 6 P), in their order."""
        if self.correlation is None:
            blocks = (self.in_use[name].correlation for name in plates)
            return np.asarray(scipy.linalg.block_diag(*blocks))
        # blocks of six rows and columns per plate
        order = list(self.plates)
        at = np.concatenate([6 * order.index(name) + np.arange(6) for name in plates])
        return np.asarray(self.correlation[np.ix_(at, at)])


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
    return write_document(
        OF,
        VERSION,
        provenance=dict(calibration.provenance),
        plates={name: asdict(model) for name, model in calibration.plates.items()},
        sensors=[asdict(sensor) for sensor in calibration.sensors],
        correlation=calibration.correlation,
        dynamic={name: asdict(model) for name, model in calibration.dynamic.items()},
    )


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
    ValueError: the text is no inertia calibration: its format should be 'hbm-residuals inertia \
calibration'; fit it again with 'hbm calibration fit'
    """
    document = read_document(text, OF, (RELEASED, VERSION), AGAIN)
    try:
        # what that version did not write
        if document["version"] == RELEASED:
            document |= {"correlation": None, "sensors": [], "dynamic": {}}
            for plain in document["plates"].values():
                plain |= UNKNOWN_THEN
        plates, dynamic = (
            {name: _model(plain) for name, plain in document[part].items()}
            for part in ("plates", "dynamic")
        )
        sensors = tuple(map(_sensor, document["sensors"]))
        calibration = Calibration(
            plates, document["provenance"], sensors, document["correlation"], dynamic
        )
    except (KeyError, TypeError, AttributeError, OverflowError) as error:
        raise damaged(OF, error, AGAIN) from error
    if setup is not None:
        for model in calibration.plates.values():
            model.require(setup)
    return calibration


def _model(plain: dict[str, Any]) -> InertiaModel:
    setup = {
        k: v for k, v in plain["setup"].items() if k not in ("acceleration_unit", "wrench_unit")
    }
    error = plain["model_error"]
    if error is not None:
        error = _exactly(ModelError, error)
    return _exactly(InertiaModel, plain | {"setup": _exactly(Setup, setup), "model_error": error})


def _sensor(plain: dict[str, Any]) -> Sensor:
    sensor = _exactly(Sensor, plain)
    numbers = [sensor.delay_s, sensor.delay_error_s or 0.0, sensor.noise_mps2 or 0.0]
    if not np.isfinite(numbers).all():
        raise TypeError(f"sensor {sensor.name}: delay or noise is no number")
    return sensor


def _exactly(kind: type[Made], plain: dict[str, Any]) -> Made:
    """Make a part from its fields, all of them and no others."""
    names = {field.name for field in fields(kind)}
    if plain.keys() != names:
        differ = ", ".join(sorted(map(str, names ^ plain.keys())))
        raise KeyError(f"{kind.__name__} lacks or should not have {differ}")
    return kind(**plain)
