"""A laboratory's plates and treadmill: corrected, with their calibrations, and in a recording."""

import json
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import Final

import numpy as np

from compensation import BeltModel, Calibration, InertiaModel, PlateCalibration, Sensor, Setup
from hbm.notes import Note
from hbm.numbers import read_numbers
from hbm.signals.filtering import Method
from hbm.signals.samples import mean_rate_hz
from hbm.spatial import Array
from pipeline.config.plate_correction import PlateCorrection
from pipeline.config.schema import Settings, Treadmill
from pipeline.io.recording import Plate, Recording
from pipeline.trial.ground.accelerometers import (
    FILTER,
    RealtimeAccelerometers,
    accelerations,
    at_plate_times,
    fastest_belt,
    sensor_delays_s,
    setup_of,
)

LIMITS: Final = read_numbers("pipeline.trial", "thresholds.toml", "laboratory")


PLATES_NAME: Final = "plate_calibration"
PLATES_SHA256: Final = "plate_calibration_sha256"
"""Keys of a calibration's provenance that name the correction of its plates."""
BESIDE: Final = "beside"
BELTS_UNKNOWN: Final = "belts_unknown"
"""Those of the recordings of people beside empty plates, and of unknown speed of the belts."""


def with_corrected_plates(recording: Recording, correction: PlateCorrection | None) -> Recording:
    """Correct the plates of a recording of any kind; without a correction it stays as it is.

    Each wrench stays in its plate's own axes, samples keep their times (`plate_delays_s` gives
    their delays), and a note says what was corrected. A ValueError where the file's plates are
    corrected or compensated already, or a plate is not where its calibration has it.

    A plate that moves is corrected in its own frame, as it stands with the platform in neutral:
    cells, amplifiers and their calibration move with it. The inertia of its belt assembly is a load
    on the cells like any other, so that it is subtracted afterwards, by a model that was fitted to
    equally corrected plates.
    """
    if correction is None or not recording.plates:
        return recording
    file, done = recording.source.name, recording.compensation
    if done is not None:
        raise ValueError(
            f"{file}: its plates are compensated or corrected already, by {done.software}; leave "
            f"{correction.name} out, or give the original recording"
        )
    plates, notes, missing = [*recording.plates], [*recording.notes], list[str]()
    for k, plate in enumerate(recording.plates):
        if (one := correction.calibrations.of(plate.number)) is None:
            missing.append(str(plate.number))
            continue
        apart_m = float(np.linalg.norm(plate.center - one.center))
        if np.isfinite(plate.corners).all() and apart_m > LIMITS.largest_shift:
            raise ValueError(
                f"{file}: plate {plate.number} lies {apart_m:.2f} m from where {correction.name} "
                "has it; are its plates numbered as in the recordings of the weights, and is the "
                "lab's origin the same?"
            )
        wrench = one.correct_in_plate(plate.wrench_in_plate, plate.rotation, plate.center)
        plates[k] = replace(plate, wrench_in_plate=wrench)
    if corrections := corrections_used(plates, correction):
        unexamined = [f"{c} of plate {one.plate}" for one in corrections for c in one.unexamined]
        note = Note.of(
            "plates_corrected",
            plates=[str(one.plate) for one in corrections],
            calibration=correction.name,
            delays_s={f"plate {one.plate}": one.delay_s or 0.0 for one in corrections},
            unexamined=unexamined or ["nothing"],
        )
        notes.append(note)
    if missing:
        notes.append(Note.of("plates_not_corrected", plates=missing, calibration=correction.name))
    return replace(recording, plates=tuple(plates), notes=tuple(notes))


def plate_delays_s(
    plates: Sequence[Plate], correction: PlateCorrection | None, stated_s: float | None
) -> list[float]:
    """Give how much later each plate is than the cameras, by its calibration or as stated [s].

    A ValueError where both are stated and differ.
    """
    if correction is None:
        return [stated_s or 0.0 for _ in plates]
    return [correction.delay_s(plate.number, stated_s) for plate in plates]


def relative_delays_s(plates: Sequence[Plate], correction: PlateCorrection | None) -> list[float]:
    """Give how much later each plate is than the first, as their calibration states it [s].

    A plate whose delay it does not state is as late as the cameras. What is stated beside it, of
    all plates alike, does not count here: a calibration of accelerometers and the trials that use
    it have to be timed alike.
    """
    delays_s = plate_delays_s(plates, correction, None)
    return [delay_s - delays_s[0] for delay_s in delays_s]


def corrections_used(
    plates: Sequence[Plate], correction: PlateCorrection | None
) -> list[PlateCalibration]:
    """Give the calibrations of those plates that have one."""
    if correction is None:
        return []
    of_plates = (correction.calibrations.of(plate.number) for plate in plates)
    return [one for one in of_plates if one is not None]


def require_same_plates(calibration: Calibration, plates: PlateCorrection | None) -> None:
    """Refuse a calibration that was fitted to plates corrected otherwise than those of trials."""
    provenance = calibration.provenance
    fitted, of_trials = (
        provenance.get(PLATES_SHA256, ""),
        plates.sha256 if plates is not None else "",
    )
    if fitted == of_trials:
        return
    used = (
        f"to plates corrected by {provenance.get(PLATES_NAME)}"
        if fitted
        else "to uncorrected plates"
    )
    if plates is None:
        advice = "name that file (plates.calibration in study.toml, --plate-calibration)"
    else:
        used += f", not by this {plates.name}" if fitted else f", but trials are by {plates.name}"
        advice = "fit it again with 'hbm calibration fit --plate-calibration'"
    raise ValueError(f"the treadmill's calibration was fitted {used}; {advice}")


@dataclass(frozen=True, slots=True)
class Laboratory:
    """The treadmill as stated, its calibration and its plates' belt models where there are any.

    Attributes
    ----------
    treadmill
        As stated.
    calibration
        Of the moving platform.
    belts
        One model per plate.
    plates
        The correction of its plates, by which those of the calibration were corrected too.
    notes
        What a recording of another day says about the calibration.

    Examples
    --------
    >>> from pipeline.config.schema import Platform
    >>> still = Laboratory(Treadmill())
    >>> moving = Laboratory(Treadmill(platform=Platform(markers=("PLAT1", "PLAT2", "PLAT3"))))
    >>> moving.calibration is still.calibration is None
    True
    """

    treadmill: Treadmill
    calibration: Calibration | None = None
    belts: tuple[BeltModel, ...] = ()
    plates: PlateCorrection | None = None
    notes: tuple[Note, ...] = ()

    def __post_init__(self) -> None:
        if self.calibration is not None:
            require_same_plates(self.calibration, self.plates)

    def filters(self, settings: Settings) -> tuple[tuple[Method, float], ...]:
        """Give method and cut-off [Hz] of every low-pass between a recording and its residuals."""
        filters: list[tuple[Method, float]] = [(settings.filter, settings.cutoff_hz)]
        live = settings.filter == "realtime"  # then compensation waits for no later sample
        if self.calibration is not None and not live:
            filters.append((FILTER, self.treadmill.cutoff_hz))
        if self.treadmill.belt is not None and not live:
            filters.append((FILTER, self.treadmill.belt.cutoff_hz))
        return tuple(filters)


def channels_of(calibration: Calibration) -> dict[str, tuple[str, str, str]]:
    """Give sensor -> its channels as a calibration file states them; empty where it does not."""
    try:
        channels = json.loads(calibration.provenance.get("channels", "{}"))
        return {str(sensor): (str(x), str(y), str(z)) for sensor, (x, y, z) in channels.items()}
    except (AttributeError, TypeError, ValueError) as error:
        raise ValueError("the calibration's channels are damaged; fit it again") from error


@dataclass(frozen=True, slots=True, eq=False)
class BoundLaboratory:
    """A laboratory in one recording: every delay, model and channel is looked up once, here.

    Attributes
    ----------
    recording, laboratory
        The recording, its plates corrected, and the treadmill with its calibrations.
    delays_s
        How much later each plate is than the markers [s].
    models
        Inertia model of each plate; empty without a calibration of the platform.
    readings
        Times (N,) [s] and readings (N, k) [m/s²] of the accelerometers; None without a calibration
        of the platform.
    belts
        Times (N,) [s] and speed (N,) [m/s] of the fastest belt; None where it is unknown, or
        without a calibration of the platform.
    """

    recording: Recording
    laboratory: Laboratory
    delays_s: tuple[float, ...]
    models: tuple[InertiaModel, ...] = ()
    readings: tuple[Array, Array] | None = None
    belts: tuple[Array, Array] | None = None

    @property
    def setup(self) -> Setup:
        """How plates and accelerometers were recorded and are filtered."""
        return setup_of(self.recording, self.laboratory.treadmill)

    @property
    def sensors(self) -> tuple[Sensor, ...]:
        """The accelerometers as the calibration found them; none without a calibration."""
        calibration = self.laboratory.calibration
        return () if calibration is None else calibration.sensors

    @property
    def sensor_delays_s(self) -> tuple[float, ...]:
        """How much later each accelerometer is than the plates [s]."""
        return sensor_delays_s(self.laboratory.treadmill, self.sensors)

    @property
    def sensors_apart_s(self) -> float:
        """By how much the accelerometers' delays differ, one standard deviation [s].

        Accelerometers on one converter are equally late: where a platform bends, the calibration
        takes bending for delay.
        """
        # sample standard deviation over sensors
        delays = [sensor.correction_s for sensor in self.sensors]
        return float(np.std(delays, ddof=1)) if len(delays) > 1 else 0.0

    @property
    def lags_s(self) -> tuple[float, ...]:
        """Lags of dynamic models [s]; none of static ones."""
        return self.models[0].lags_s if self.models else ()

    @property
    def correlation(self) -> Array:
        """Between all components of what the models leave, (6 P, 6 P); empty without models."""
        calibration = self.laboratory.calibration
        if calibration is None:
            return np.zeros((0, 0))
        return calibration.correlation_of([f"plate {p.number}" for p in self.recording.plates])

    def accelerations(
        self, times: Sequence[Array], method: Method = FILTER, *, low_passed: bool = True
    ) -> list[Array]:
        """Give what the accelerometers measure for each plate at its own times (T,), (T, K) [m/s²].

        They are read as for the first plate, through the low-pass of the calibration or, but for
        the differences of a dynamic model, without. In real time they pass no low-pass: the
        wrenches do, later.
        """
        assert self.readings is not None
        clock, readings = self.readings
        # accelerometers are timed by the first plate
        late = relative_delays_s(self.recording.plates, self.laboratory.plates)
        earlier = [time - late_s for time, late_s in zip(times, late, strict=True)]
        if method == "realtime":
            rates_hz = mean_rate_hz(clock), self.recording.markers.rate_hz
            live = RealtimeAccelerometers.of(self.sensor_delays_s, self.lags_s, *rates_hz)
            read = partial(live.resampling.evaluate, clock, readings)
            return [live.accelerations(read, at) for at in earlier]
        filtered = self.setup.low_pass(readings, clock)
        sensed = filtered if low_passed else readings
        return at_plate_times(clock, sensed, filtered, earlier, self.sensor_delays_s, self.lags_s)


def bind(
    recording: Recording, laboratory: Laboratory, plate_delay_s: float | None = None
) -> BoundLaboratory:
    """Look up a laboratory's instruments in a recording whose plates are corrected.

    The stated delay [s] holds for all plates. A ValueError where the plates are compensated
    already, a channel is missing, two different delays are stated, or the calibration was made for
    other plates, sensors, channels or rates; sensors may have exchanged their channels since.
    """
    require_uncompensated(recording, laboratory)
    treadmill, calibration = laboratory.treadmill, laboratory.calibration
    delays_s = tuple(plate_delays_s(recording.plates, laboratory.plates, plate_delay_s))
    if calibration is None:
        return BoundLaboratory(recording, laboratory, delays_s)
    readings, file = accelerations(recording, treadmill), recording.source.name
    fitted = channels_of(calibration)
    present = recording.analog.names if recording.analog is not None else ()
    for sensor, channels in treadmill.accelerometers.items():
        then = tuple(fitted.get(sensor, channels))
        exchanged = channels in fitted.values()
        # other channels than in the calibration, though the old ones are there too
        if then != channels and set(then) <= set(present) and not exchanged:
            raise ValueError(
                f"{file}: accelerometer {sensor} was {', '.join(then)} in the calibration, which "
                f"this recording has too, but {', '.join(channels)} is given; recording and "
                "calibration need the same channels"
            )
    numbers, setup = [plate.number for plate in recording.plates], setup_of(recording, treadmill)
    models = tuple(models_of_plates(calibration, numbers, setup, file))
    belts = fastest_belt(recording, treadmill)
    return BoundLaboratory(recording, laboratory, delays_s, models, readings, belts)


def models_of_plates(
    calibration: Calibration, numbers: Sequence[int], setup: Setup, name: str
) -> list[InertiaModel]:
    """Give the inertia models of plates with these numbers, which are recorded as the setup says.

    A ValueError, which names what is compensated, where the calibration was made for other plates,
    sensors, rates or filters.
    """
    models, names = calibration.in_use, [f"plate {number}" for number in numbers]
    if unknown := [plate for plate in names if plate not in models]:
        raise ValueError(f"{name}: the calibration has no {unknown[0]}; it has {', '.join(models)}")
    for plate in names:
        try:
            models[plate].require(setup)
        except ValueError as error:
            raise ValueError(f"{name}: {plate}: {error}") from error
    return [models[plate] for plate in names]


def require_uncompensated(recording: Recording, laboratory: Laboratory) -> None:
    """Refuse to subtract or to turn a second time what is done in a file's plates already."""
    done, file = recording.compensation, recording.source.name
    if done is None:
        return
    if laboratory.calibration is not None or laboratory.treadmill.belt is not None:
        raise ValueError(
            f"{file}: its plates are compensated already, by {done.software}; leave the "
            "calibration out, or give the original recording"
        )
    if done.frame != "recorded" and laboratory.treadmill.platform is not None:
        raise ValueError(
            f"{file}: {done.software} has brought its plates to the lab (--frame {done.frame}); "
            "leave the platform's markers or channels out, or give the original recording"
        )
