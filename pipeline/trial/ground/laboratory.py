"""A laboratory's treadmill: as stated, with its calibration, and bound to a recording."""

import json
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from compensation import BeltModel, Calibration, InertiaModel, Sensor, Setup
from hbm.notes import Note
from hbm.signals.filtering import Method
from hbm.spatial import Array
from pipeline.config.plate_correction import PlateCorrection
from pipeline.config.schema import Settings, Treadmill
from pipeline.io.recording import Recording
from pipeline.trial.ground.accelerometers import (
    RealtimeAccelerometers,
    accelerations,
    at_plate_times,
    fastest_belt,
    sensor_delays_s,
)
from pipeline.trial.ground.calibration_recording import (
    FILTER,
    PLATES_NAME,
    PLATES_SHA256,
    setup_of,
)
from pipeline.trial.ground.corrected_plates import plate_delays_s, relative_delays_s


def require_same_plates(calibration: Calibration, plates: PlateCorrection | None) -> None:
    """Refuse a calibration that was fitted to plates corrected otherwise than those of trials."""
    known = calibration.provenance
    fitted, wanted = known.get(PLATES_SHA256, ""), plates.sha256 if plates is not None else ""
    if fitted == wanted:
        return
    used = f"to plates corrected by {known.get(PLATES_NAME)}" if fitted else "to uncorrected plates"
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
        found = [(settings.filter, settings.cutoff_hz)]
        if settings.filter == "realtime":  # compensation waits for no later sample
            return tuple(found)
        if self.calibration is not None:
            found.append((FILTER, self.treadmill.cutoff_hz))
        if self.treadmill.belt is not None:
            found.append((FILTER, self.treadmill.belt.cutoff_hz))
        return tuple(found)


def plate_models(recording: Recording, laboratory: Laboratory) -> list[InertiaModel]:
    """Give the inertia model that compensates each plate of a trial; none without a calibration.

    A ValueError where the calibration was made for other plates, sensors, channels or rates;
    sensors may have exchanged their channels since.
    """
    calibration, treadmill = laboratory.calibration, laboratory.treadmill
    if calibration is None:
        return []
    file, fitted = recording.source.name, channels_of(calibration)
    present = recording.analog.names if recording.analog is not None else ()
    for sensor, channels in treadmill.accelerometers.items():
        then = tuple(fitted.get(sensor, channels))
        exchanged = channels in fitted.values()
        if then != channels and set(then) <= set(present) and not exchanged:
            raise ValueError(
                f"{file}: accelerometer {sensor} was {', '.join(then)} in the calibration, which "
                f"this recording has too, but {', '.join(channels)} is given; recording and "
                "calibration need the same channels"
            )
    numbers = [plate.number for plate in recording.plates]
    return models_of_plates(calibration, numbers, setup_of(recording, treadmill), file)


def channels_of(calibration: Calibration) -> dict[str, tuple[str, str, str]]:
    """Give sensor -> its channels as a calibration file states them; empty where it does not."""
    try:
        known = json.loads(calibration.provenance.get("channels", "{}"))
        return {str(sensor): (str(x), str(y), str(z)) for sensor, (x, y, z) in known.items()}
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
    readings, filtered
        Times (N,) [s] and readings (N, k) [m/s²] of the accelerometers, as recorded and through the
        low-pass of the calibration; None without one.
    belts
        Times (N,) [s] and speed (N,) [m/s] of the fastest belt; None where it is unknown, or
        without a calibration of the platform.
    """

    recording: Recording
    laboratory: Laboratory
    delays_s: tuple[float, ...]
    models: tuple[InertiaModel, ...] = ()
    readings: tuple[Array, Array] | None = None
    filtered: tuple[Array, Array] | None = None
    belts: tuple[Array, Array] | None = None

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

    def felt(self, times: Sequence[Array], method: Method) -> list[Array]:
        """Give what the accelerometers felt for each plate at its own times (T,), (T, K) [m/s²].

        They are read as for the first plate. In real time they pass no low-pass: the wrenches do,
        later.
        """
        assert self.readings is not None
        assert self.filtered is not None
        late = relative_delays_s(self.recording.plates, self.laboratory.plates)
        earlier = [time - late_s for time, late_s in zip(times, late, strict=True)]
        if method != "realtime":
            return at_plate_times(*self.filtered, earlier, self.sensor_delays_s, self.lags_s)
        assert self.recording.analog is not None
        rates_hz = self.recording.analog.rate_hz, self.recording.markers.rate_hz
        live = RealtimeAccelerometers.of(self.sensor_delays_s, self.lags_s, *rates_hz)
        return [live.felt(*self.readings, at) for at in earlier]


def bind(
    recording: Recording, laboratory: Laboratory, plate_delay_s: float | None = None
) -> BoundLaboratory:
    """Look up a laboratory's instruments in a recording whose plates are corrected.

    The stated delay [s] holds for all plates. A ValueError where the plates are compensated
    already, the calibration does not fit, a channel is missing, or two different delays are stated.
    """
    require_uncompensated(recording, laboratory)
    treadmill = laboratory.treadmill
    delays_s = tuple(plate_delays_s(recording.plates, laboratory.plates, plate_delay_s))
    if laboratory.calibration is None:
        return BoundLaboratory(recording, laboratory, delays_s)
    clock, readings = accelerations(recording, treadmill)
    models = tuple(plate_models(recording, laboratory))
    filtered = clock, setup_of(recording, treadmill).low_pass(readings, clock)
    return BoundLaboratory(
        recording,
        laboratory,
        delays_s,
        models,
        (clock, readings),
        filtered,
        fastest_belt(recording, treadmill),
    )


def models_of_plates(
    calibration: Calibration, numbers: Sequence[int], setup: Setup, name: str
) -> list[InertiaModel]:
    """Give the inertia models of plates with these numbers, which are recorded as the setup says.

    A ValueError, which names what is compensated, where the calibration was made for other plates,
    sensors, rates or filters.
    """
    known, wanted = calibration.in_use, [f"plate {number}" for number in numbers]
    if unknown := [plate for plate in wanted if plate not in known]:
        raise ValueError(f"{name}: the calibration has no {unknown[0]}; it has {', '.join(known)}")
    for plate in wanted:
        try:
            known[plate].require(setup)
        except ValueError as error:
            raise ValueError(f"{name}: {plate}: {error}") from error
    return [known[plate] for plate in wanted]


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
