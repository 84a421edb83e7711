"""What acts on the subject: the plates' wrenches in the lab, as measured and compensated."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np

from compensation import (
    InertiaModel,
    PlatformPose,
)
from compensation.inertia.model_error import SLOW_HZ
from hbm.notes import Note
from hbm.signals.filtering import Method
from hbm.signals.resampling import interpolate, resample, resample_in_real_time
from hbm.spatial import Array, Mask
from pipeline.io.recording import Plate, Recording
from pipeline.trial.ground.accelerometers import (
    RealtimeAccelerometers,
    accelerations,
    at_times_of_plates,
    corrected_sensors,
)
from pipeline.trial.ground.artefacts import compensation_doubts
from pipeline.trial.ground.belts import belt_wrenches, belt_wrenches_in_real_time
from pipeline.trial.ground.corrected_plates import plate_delays_s, relative_delays_s
from pipeline.trial.ground.empty_plates import BESIDE, FILTER, setup_of
from pipeline.trial.ground.instruments import fastest_belt
from pipeline.trial.ground.laboratory import Laboratory, plate_models, require_uncompensated
from pipeline.trial.ground.platform import (
    NEUTRAL_FRAMES,
    in_lab,
    pivot_error_budget,
    platform_pose,
)
from pipeline.trial.ground.platform_delay import plate_marker_delay, plates_note
from pipeline.trial.ground.uncertainty import (
    Spread,
    belt_speed_notes,
    sum_covariance,
    wrench_spread,
)


@dataclass(frozen=True, slots=True)
class Ground:
    """The wrenches of the plates on the subject.

    Attributes
    ----------
    variants
        "measured" and, with a calibration of platform or belts, "compensated" -> per plate its
        wrench at the markers' times, lab axes about the lab origin, unfiltered, (T, 6) [N, N·m].
    pose
        The platform's pose at the markers' times; None where it stands still.
    notes
        How the wrenches were compensated and brought to the lab, and what is doubtful about that.
    spreads
        Per plate what the compensation makes uncertain; empty without a calibration of the
        platform.
    correlation
        Between all plates, as `sum_covariance` takes it, (6 P, 6 P).
    felt
        Per plate what the accelerometers felt at the markers' times, as its inertia model takes it,
        (T, K) [m/s²]; empty without a calibration of the platform.
    belts
        Per plate what was subtracted of its accelerating belt, in the plate's own axes, (T, 6)
        [N, N·m]; empty without a calibration of the belts.
    accelerations
        Times (N,) [s] and readings (N, k) [m/s²] of the accelerometers, through the low-pass of
        the calibration; None without a calibration of the platform.
    """

    variants: Mapping[str, Sequence[Array]]
    pose: PlatformPose | None
    notes: tuple[Note, ...]
    spreads: tuple[Spread, ...] = ()
    correlation: Array = field(default_factory=lambda: np.zeros((0, 0)))
    felt: tuple[Array, ...] = ()
    belts: tuple[Array, ...] = ()
    accelerations: tuple[Array, Array] | None = None

    @property
    def best(self) -> str:
        """The variant that is closest to the truth: compensated where there is one."""
        return "compensated" if "compensated" in self.variants else "measured"

    @property
    def known(self) -> Mask:
        """Frames in which every plate of every variant is known, (T,)."""
        every = np.stack([wrench for each in self.variants.values() for wrench in each])
        return np.asarray(np.isfinite(every).all(axis=(0, 2)))

    @property
    def of_each(self) -> list[tuple[Spread, Array]]:
        """Per plate its spread and the correlation within it, (6, 6)."""
        own = [slice(6 * k, 6 * k + 6) for k in range(len(self.spreads))]
        return [(s, self.correlation[k, k]) for s, k in zip(self.spreads, own, strict=True)]

    @property
    def covariances(self) -> list[Array]:
        """Per plate that of its wrench, lab axes about the lab origin, (T, 6, 6)."""
        return [sum_covariance([spread], correlation) for spread, correlation in self.of_each]

    @property
    def covariance(self) -> Array:
        """As `covariances`, of the sum of all plates."""
        return sum_covariance(self.spreads, self.correlation)


def ground_wrenches(
    recording: Recording,
    laboratory: Laboratory,
    time: Array,
    plate_delay_s: float | None,
    cutoff_hz: float = SLOW_HZ,
    method: Method = "zero_phase",
) -> Ground:
    """Bring every plate to the markers' times and into the lab, as measured and compensated.

    Parameters
    ----------
    recording
        The trial, its plates corrected.
    laboratory
        The treadmill.
    time
        Marker times, (T,) [s].
    plate_delay_s
        How much later the plates are than the markers [s]; None as their calibration states it.
    cutoff_hz
        Of the filter that the wrenches pass next, which leaves less of their noise [Hz].
    method
        Of that filter. With "realtime" nothing here waits for the end of the trial either: plates,
        accelerometers and belts are brought to the markers' times by a convolution of short reach
        and nothing else. Compensation is linear, so that the real-time filter that the difference
        passes afterwards does the same as one on plates and accelerometers before.

    Returns
    -------
    Ground
        Both variants move with the platform. What platform and belts add is subtracted in each
        plate's own moving frame, before any rotation. Plates and accelerometers pass the low-pass
        of the calibration before the platform's inertia is subtracted, but not in real time. The
        gains are constant, and the differences of a dynamic model are taken at the accelerometers'
        rate, so that it makes no difference that this is done at the markers' rate on equally
        resampled signals. In real time no wrench is known while the platform's markers still show
        their neutral places, which takes `NEUTRAL_FRAMES`.

    Raises
    ------
    ValueError
        If the calibration does not fit the trial, a channel or platform marker is missing, the
        file's plates are compensated already, or two different delays are stated of a plate.
    """
    require_uncompensated(recording, laboratory)
    plates, treadmill = recording.plates, laboratory.treadmill
    delays_s = plate_delays_s(plates, laboratory.plates, plate_delay_s)
    times = [time + delay for delay in delays_s]
    at_markers = resample_in_real_time if method == "realtime" else resample
    measured = [
        at_markers(p.time, p.wrench_in_plate, t) for p, t in zip(plates, times, strict=True)
    ]
    notes = [Note.of("plate_constant", plate=p.number) for p in plates if _is_constant(p)]

    compensated, felt, added = measured, list[Array](), list[Array]()
    filtered = None
    if laboratory.calibration is not None:
        clock, readings = accelerations(recording, treadmill)
        models = plate_models(recording, laboratory)
        filtered = clock, setup_of(recording, treadmill).low_pass(readings, clock)
        if method == "realtime":
            plain = measured
            felt = _felt_in_real_time(recording, laboratory, models, (clock, readings), times)
        else:
            plain, felt = _low_passed(recording, laboratory, models, filtered, times)
        compensated = [_compensated(*each) for each in zip(models, felt, plain, strict=True)]
        notes += _compensation_notes(recording, laboratory, models, readings, method)
    if laboratory.belts and treadmill.belt is not None:
        in_time = belt_wrenches_in_real_time if method == "realtime" else belt_wrenches
        added = in_time(recording, laboratory.belts, treadmill.belt, times)
        compensated = [w - belt for w, belt in zip(compensated, added, strict=True)]
        notes.append(Note.of("belts_compensated", channels=treadmill.belt.speed_channels))

    pose, pose_notes = platform_pose(recording, treadmill.platform, time, at_markers)
    notes += pose_notes
    if pose is None and laboratory.calibration is not None:
        notes.append(Note.of("platform_taken_as_level"))
    if pose is not None and treadmill.platform is not None and treadmill.platform.pitch_channel:
        notes.append(pivot_error_budget(pose, np.sum(measured, axis=0)[:, :3]))
    variants = {"measured": measured}
    if compensated is not measured:
        variants["compensated"] = compensated
    moved = {name: in_lab(wrenches, plates, pose) for name, wrenches in variants.items()}
    if method == "realtime" and treadmill.platform is not None and treadmill.platform.markers:
        for wrench in (w for wrenches in moved.values() for w in wrenches):
            wrench[:NEUTRAL_FRAMES] = np.nan
    spreads, joint = list[Spread](), np.zeros((0, 0))
    if laboratory.calibration is not None:
        if pose is not None and treadmill.platform is not None and treadmill.platform.markers:
            readings = felt[0][:, : len(models[0].acceleration_mean)]
            late = plate_marker_delay(pose, readings, recording.markers.rate_hz)
            notes += plates_note(late, delays_s[0])
        rate_hz = recording.markers.rate_hz
        speed = fastest_belt(recording, treadmill)
        belts_mps = None if speed is None else interpolate(*speed, times[0])
        spreads = [
            wrench_spread(model, acceleration, plate, pose, cutoff_hz, rate_hz, belts_mps)
            for model, plate, acceleration in zip(models, plates, felt, strict=True)
        ]
        joint = laboratory.calibration.correlation_of([f"plate {p.number}" for p in plates])
        if laboratory.calibration.correlation is None and len(plates) > 1:
            notes.append(Note.of("plates_taken_as_independent"))
    return Ground(
        variants=moved,
        pose=pose,
        notes=tuple(notes),
        spreads=tuple(spreads),
        correlation=joint,
        felt=tuple(felt),
        belts=tuple(added),
        accelerations=filtered,
    )


def _is_constant(plate: Plate) -> bool:
    return bool((plate.wrench_in_plate == plate.wrench_in_plate[0]).all())


def _low_passed(
    recording: Recording,
    laboratory: Laboratory,
    models: Sequence[InertiaModel],
    filtered: tuple[Array, Array],
    times: Sequence[Array],
) -> tuple[list[Array], list[Array]]:
    """Give each plate, (T, 6), and what the accelerometers felt for it, (T, K), at its times (T,).

    The accelerometers' filtered readings are given with their times. Plates and accelerometers both
    pass the low-pass that both passed in the calibration: filtering only one of them would leave
    the part of the artefact that the filter takes from the other.
    """
    treadmill, setup = laboratory.treadmill, setup_of(recording, laboratory.treadmill)
    assert laboratory.calibration is not None
    earlier = _of_accelerometers(recording, laboratory, times)
    sensors = laboratory.calibration.sensors
    felt = at_times_of_plates(*filtered, earlier, treadmill, sensors, models[0].lags_s)
    wrenches = [
        resample(plate.time, setup.low_pass(plate.wrench_in_plate, plate.time), time)
        for plate, time in zip(recording.plates, times, strict=True)
    ]
    return wrenches, felt


def _felt_in_real_time(
    recording: Recording,
    laboratory: Laboratory,
    models: Sequence[InertiaModel],
    readings: tuple[Array, Array],
    times: Sequence[Array],
) -> list[Array]:
    """Give what the accelerometers felt for each plate, (T, K), without their low-pass."""
    assert laboratory.calibration is not None
    assert recording.analog is not None
    sensors = RealtimeAccelerometers.of(
        laboratory.treadmill,
        laboratory.calibration.sensors,
        models[0].lags_s,
        recording.analog.rate_hz,
        recording.markers.rate_hz,
    )
    earlier = _of_accelerometers(recording, laboratory, times)
    return [sensors.felt(*readings, at) for at in earlier]


def _of_accelerometers(
    recording: Recording, laboratory: Laboratory, times: Sequence[Array]
) -> list[Array]:
    """Give the instants at which accelerometers are read for each plate: as for the first one."""
    late = relative_delays_s(recording.plates, laboratory.plates)
    return [time - late_s for time, late_s in zip(times, late, strict=True)]


def _compensation_notes(
    recording: Recording,
    laboratory: Laboratory,
    models: list[InertiaModel],
    readings: Array,
    method: Method,
) -> list[Note]:
    """Say how plates were compensated by accelerometers, and what is doubtful about their readings.

    The readings (N, k) are as recorded.
    """
    treadmill, calibration = laboratory.treadmill, laboratory.calibration
    assert calibration is not None
    notes = compensation_doubts(calibration, models[0], readings, treadmill)
    sensors = tuple(treadmill.accelerometers)
    if method == "realtime":
        notes.append(Note.of("plates_compensated_in_real_time", accelerometers=sensors))
    else:
        notes.append(
            Note.of(
                "plates_compensated",
                accelerometers=sensors,
                filter=FILTER,
                cutoff_hz=treadmill.cutoff_hz,
            )
        )
    if models[0].lags_s:
        lags_ms = tuple(f"{1000 * lag_s:g}" for lag_s in models[0].lags_s)
        notes.append(Note.of("compensated_dynamically", lags_ms=lags_ms))
    if any(model.model_error is None for model in models):
        notes.append(Note.of("uncertainty_of_noise_alone"))
    elif BESIDE not in calibration.provenance:
        notes.append(Note.of("uncertainty_without_people"))
    notes += belt_speed_notes(recording, treadmill, calibration)
    return [*notes, *corrected_sensors(calibration.sensors), *laboratory.notes]


def _compensated(model: InertiaModel, acceleration: Array, wrench: Array) -> Array:
    """Compensate the samples that have both; the others stay gaps."""
    known = np.isfinite(acceleration).all(axis=1) & np.isfinite(wrench).all(axis=1)
    result = np.full(wrench.shape, np.nan)
    result[known] = model.compensate(acceleration[known], wrench[known])
    return result
