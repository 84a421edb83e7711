"""Ground: samples of plates, accelerometers, belts and platform to wrenches of every plate."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Final

import numpy as np

from compensation import Calibration, InertiaModel, PlatformPose, check_trial
from compensation.inertia.model_error import SLOW_HZ
from hbm.notes import Note
from hbm.signals.filtering import Method
from hbm.signals.resampling import interpolate, resample, resample_in_real_time
from hbm.spatial import Array, Mask, read_only
from pipeline.config.schema import Treadmill
from pipeline.io.recording import Plate, Recording
from pipeline.trial.ground.accelerometers import (
    at_plate_times,
    at_times_of_plates,
    corrected_sensors,
    hold_ends,
    mean_belt_speed,
)
from pipeline.trial.ground.belts import belt_wrenches, belt_wrenches_in_real_time
from pipeline.trial.ground.calibration_recording import BESIDE, FILTER, samples_of, setup_of
from pipeline.trial.ground.corrected_plates import relative_delays_s
from pipeline.trial.ground.laboratory import BoundLaboratory, Laboratory, bind
from pipeline.trial.ground.platform import (
    NEUTRAL_FRAMES,
    in_lab,
    pivot_error_budget,
    plate_marker_delay,
    plates_note,
    platform_pose,
)
from pipeline.trial.ground.uncertainty import (
    Spread,
    belt_speed_notes,
    sum_deviation,
    wrench_spread,
)
from pipeline.trial.result import CompensationUncertainty

MIN_NOTED_S: Final = 0.02
"""Two samples of the belts' model, which ends with its last whole interval."""


def plate_artefacts(
    recording: Recording, laboratory: Laboratory
) -> tuple[list[Array], tuple[Note, ...]]:
    """Predict what the platform's motion and accelerating belts add to each plate.

    Parameters
    ----------
    recording
        The trial.
    laboratory
        The treadmill with the calibration of its platform, its belts, or both.

    Returns
    -------
    artefacts
        Per plate at its own samples, in its own moving frame about the centre of its surface,
        (N, 6) [N, N·m]. The accelerations are not low-passed; those of the belts are, as their
        model requires.
    notes
        What is doubtful about calibration and trial, and where a prediction was held.

    Raises
    ------
    ValueError
        The calibration does not fit the trial, a channel is missing, or the prediction is unknown
        within the trial or for more than 0.5 s at one of its ends.
    """
    plates, treadmill = recording.plates, laboratory.treadmill
    artefacts = [np.zeros((len(plate.time), 6)) for plate in plates]
    notes: list[Note] = []
    if laboratory.calibration is not None:
        lab = bind(recording, laboratory)
        assert lab.readings is not None
        delays_s = relative_delays_s(plates, laboratory.plates)
        for k, (artefact, plate) in enumerate(zip(artefacts, plates, strict=True)):
            felt = _felt(lab, plate.time - delays_s[k])
            felt = _held(felt, recording, plate, "the acceleration", notes)
            artefact += lab.models[k].predict(felt)
        readings = lab.readings[1]
        notes += compensation_doubts(laboratory.calibration, lab.models[0], readings, treadmill)
    if laboratory.belts and treadmill.belt is not None:
        added = belt_wrenches(
            recording, laboratory.belts, treadmill.belt, [plate.time for plate in plates]
        )
        for artefact, plate, wrench in zip(artefacts, plates, added, strict=True):
            artefact += _held(wrench, recording, plate, "the belts' acceleration", notes)
    return artefacts, tuple(notes)


def compensation_doubts(
    calibration: Calibration, model: InertiaModel, readings: Array, treadmill: Treadmill
) -> list[Note]:
    """Find what is doubtful about a calibration and about a trial's accelerations (N, k)."""
    known = samples_of(readings, np.isfinite(readings).all(axis=1))
    return [*calibration.notes, *check_trial(model, known, treadmill.accelerometer_range_g)]


def _felt(lab: BoundLaboratory, time: Array) -> Array:
    """Give the accelerations at a plate's times: readings unfiltered, differences filtered."""
    assert lab.readings is not None
    assert lab.filtered is not None
    treadmill, sensors = lab.laboratory.treadmill, lab.sensors
    felt = at_plate_times(*lab.readings, time, treadmill, sensors)
    if not lab.lags_s:
        return felt
    both = at_plate_times(*lab.filtered, time, treadmill, sensors, lab.lags_s)
    return np.hstack([felt, both[:, felt.shape[1] :]])


def _held(values: Array, recording: Recording, plate: Plate, what: str, notes: list[Note]) -> Array:
    try:
        held, held_s = hold_ends(plate.time, values, what)
    except ValueError as error:
        raise ValueError(f"{recording.source.name}: {error}") from error
    note = Note.of("compensation_held", held_s=held_s)
    if held_s > MIN_NOTED_S and note not in notes:
        notes.append(note)
    return held


@dataclass(frozen=True, slots=True, eq=False)
class Ground:
    """The wrenches of the plates on the subject.

    Attributes
    ----------
    in_plates
        "measured" and, with a calibration of platform or belts, "compensated" -> per plate its
        wrench at the markers' times, in its own axes about the centre of its surface, unfiltered,
        (T, 6) [N, N·m].
    variants
        The same in lab axes about the lab origin.
    pose
        The platform's pose at the markers' times; None where it stands still.
    spreads
        Per plate what the compensation makes uncertain; empty without a calibration of the
        platform.
    correlation
        Between all plates, as `sum_deviation` takes it, (6 P, 6 P).
    felt
        Per plate what the accelerometers felt at the markers' times, as its inertia model takes it,
        (T, K) [m/s²]; empty without a calibration of the platform.
    belts
        Per plate what was subtracted of its accelerating belt, in the plate's own axes, (T, 6)
        [N, N·m]; empty without a calibration of the belts.
    """

    in_plates: Mapping[str, Sequence[Array]]
    variants: Mapping[str, Sequence[Array]]
    pose: PlatformPose | None
    spreads: tuple[Spread, ...] = ()
    correlation: Array = field(default_factory=lambda: np.zeros((0, 0)))
    felt: tuple[Array, ...] = ()
    belts: tuple[Array, ...] = ()

    @property
    def best(self) -> str:
        """The variant that is closest to the truth: the last one."""
        return [*self.variants][-1]

    @property
    def known(self) -> Mask:
        """Frames in which every plate of every variant is known, (T,)."""
        every = np.stack([wrench for each in self.variants.values() for wrench in each])
        return np.asarray(np.isfinite(every).all(axis=(0, 2)))

    def uncertainty(self, pelvis: Array) -> CompensationUncertainty | None:
        """Give what the compensation makes uncertain, residuals about the pelvis, (T, 3) [m]."""
        if not self.spreads:
            return None
        plates = []
        for k, spread in enumerate(self.spreads):
            own = slice(6 * k, 6 * k + 6)
            plates.append(sum_deviation([spread], self.correlation[own, own], np.zeros(3)))
        residual = sum_deviation(self.spreads, self.correlation, pelvis)
        return CompensationUncertainty(tuple(plates), residual)


def ground_wrenches(
    lab: BoundLaboratory,
    time: Array,
    notes: list[Note],
    cutoff_hz: float = SLOW_HZ,
    method: Method = "zero_phase",
) -> Ground:
    """Bring every plate to the markers' times and into the lab, as measured and compensated.

    Parameters
    ----------
    lab
        The laboratory in this trial.
    time
        Marker times, (T,) [s].
    notes
        Here it is added how the wrenches were compensated and brought to the lab, and what is
        doubtful about that.
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
        All variants move with the platform. What platform and belts add is subtracted in each
        plate's own moving frame, before any rotation. Plates and accelerometers pass the low-pass
        of the calibration before the platform's inertia is subtracted, but not in real time. The
        gains are constant, and the differences of a dynamic model are taken at the accelerometers'
        rate, so that it makes no difference that this is done at the markers' rate on equally
        resampled signals. In real time no wrench is known while the platform's markers still show
        their neutral places, which takes `NEUTRAL_FRAMES`.

    Raises
    ------
    ValueError
        If a channel or platform marker is missing.
    """
    recording, laboratory, plates = lab.recording, lab.laboratory, lab.recording.plates
    platform, belt = laboratory.treadmill.platform, laboratory.treadmill.belt
    live = method == "realtime"
    times, at_markers = (
        [time + s for s in lab.delays_s],
        resample_in_real_time if live else resample,
    )
    measured = [
        at_markers(p.time, p.wrench_in_plate, t) for p, t in zip(plates, times, strict=True)
    ]
    notes += [Note.of("plate_constant", plate=p.number) for p in plates if _is_constant(p)]

    variants, felt, added = {"measured": measured}, list[Array](), list[Array]()
    if lab.models:
        plain, felt = measured, lab.felt(times, method)
        if not live:
            # both pass the low-pass of the calibration: filtering only one of them would leave
            # the part of the artefact that the filter takes from the other
            low_pass = setup_of(recording, laboratory.treadmill).low_pass
            plain = [
                resample(p.time, low_pass(p.wrench_in_plate, p.time), t)
                for p, t in zip(plates, times, strict=True)
            ]
        each = zip(lab.models, felt, plain, strict=True)
        variants["compensated"] = [_compensated(*one) for one in each]
        notes += _compensation_notes(lab, method)
    if laboratory.belts and belt is not None:
        in_time = belt_wrenches_in_real_time if live else belt_wrenches
        added = in_time(recording, laboratory.belts, belt, times)
        shaken = variants.get("compensated", measured)
        variants["compensated"] = [w - own for w, own in zip(shaken, added, strict=True)]
        notes.append(Note.of("belts_compensated", channels=belt.speed_channels))

    pose, pose_notes = platform_pose(recording, platform, time, at_markers)
    notes += pose_notes
    marked = pose is not None and platform is not None and bool(platform.markers)
    if pose is None and lab.models:
        notes.append(Note.of("platform_taken_as_level"))
    if pose is not None and platform is not None and platform.pitch_channel:
        notes.append(pivot_error_budget(pose, np.sum(measured, axis=0)[:, :3]))
    if live and marked:
        for wrench in (w for wrenches in variants.values() for w in wrenches):
            wrench[:NEUTRAL_FRAMES] = np.nan
    if marked and lab.models:
        assert pose is not None
        readings = felt[0][:, : len(lab.models[0].acceleration_mean)]
        late = plate_marker_delay(pose, readings, recording.markers.rate_hz)
        notes += plates_note(late, lab.delays_s[0])
    belts_mps = None if lab.belts is None else interpolate(*lab.belts, times[0])
    rates_hz = cutoff_hz, recording.markers.rate_hz
    return Ground(
        in_plates=variants,
        variants={name: in_lab(wrenches, plates, pose) for name, wrenches in variants.items()},
        pose=pose,
        spreads=tuple(
            wrench_spread(model, acceleration, plate, pose, *rates_hz, belts_mps)
            for model, plate, acceleration in zip(lab.models, plates, felt, strict=False)
        ),
        correlation=lab.correlation,
        felt=tuple(felt),
        belts=tuple(added),
    )


def _is_constant(plate: Plate) -> bool:
    return bool((plate.wrench_in_plate == plate.wrench_in_plate[0]).all())


def _compensation_notes(lab: BoundLaboratory, method: Method) -> list[Note]:
    """Say how plates were compensated by accelerometers, and what is doubtful about it."""
    treadmill, calibration = lab.laboratory.treadmill, lab.laboratory.calibration
    assert calibration is not None
    assert lab.readings is not None
    notes = compensation_doubts(calibration, lab.models[0], lab.readings[1], treadmill)
    sensors = tuple(treadmill.accelerometers)
    if method == "realtime":
        notes.append(Note.of("plates_compensated_in_real_time", accelerometers=sensors))
    else:
        cutoff = {"filter": FILTER, "cutoff_hz": treadmill.cutoff_hz}
        notes.append(Note.of("plates_compensated", accelerometers=sensors, **cutoff))
    if lab.lags_s:
        lags_ms = tuple(f"{1000 * lag_s:g}" for lag_s in lab.lags_s)
        notes.append(Note.of("compensated_dynamically", lags_ms=lags_ms))
    if any(model.model_error is None for model in lab.models):
        notes.append(Note.of("uncertainty_of_noise_alone"))
    elif BESIDE not in calibration.provenance:
        notes.append(Note.of("uncertainty_without_people"))
    if calibration.correlation is None and len(lab.models) > 1:
        notes.append(Note.of("plates_taken_as_independent"))
    notes += belt_speed_notes(mean_belt_speed(lab.belts), calibration)
    return [*notes, *corrected_sensors(lab.sensors), *lab.laboratory.notes]


def _compensated(model: InertiaModel, acceleration: Array, wrench: Array) -> Array:
    """Compensate the samples that have both; the others stay gaps."""
    known = np.isfinite(acceleration).all(axis=1) & np.isfinite(wrench).all(axis=1)
    result = np.full(wrench.shape, np.nan)
    result[known] = model.compensate(acceleration[known], wrench[known])
    return result


@dataclass(frozen=True, slots=True)
class PlateLoad:
    """The load on one plate.

    Attributes
    ----------
    number
        The plate's number in the file.
    time
        Of its samples, on the markers' clock, (N,) [s].
    force
        Normal to its surface, on the subject, (N,) [N]; NaN where unknown.
    step_s
        Median time from one sample to the next.
    """

    number: int
    time: Array
    force: Array
    step_s: float = field(init=False)

    def __post_init__(self) -> None:
        for name in ("time", "force"):
            object.__setattr__(self, name, read_only(getattr(self, name)))
        if self.time.shape != self.force.shape or self.time.ndim != 1:
            raise ValueError(
                f"plate {self.number}: force {self.force.shape} does not fit the times "
                f"{self.time.shape}"
            )
        object.__setattr__(self, "step_s", float(np.median(np.diff(self.time))))


def plate_loads(lab: BoundLaboratory) -> tuple[PlateLoad, ...]:
    """Give the load on every plate, without what the platform's motion adds where that is known.

    The plates' samples stay unfiltered: a low-pass would begin contact early. The prediction that
    is subtracted from them is of accelerations that pass the calibration's low-pass. Accelerating
    belts add moments only.
    """
    plates = lab.recording.plates
    forces = [plate.wrench_in_plate[:, :3] @ plate.rotation[2] for plate in plates]
    if lab.filtered is not None:
        treadmill, times = lab.laboratory.treadmill, [plate.time for plate in plates]
        felt = at_times_of_plates(*lab.filtered, times, treadmill, lab.sensors, lab.lags_s)
        forces = [
            force - _predicted(model, one, plate.rotation[2])
            for force, model, one, plate in zip(forces, lab.models, felt, plates, strict=True)
        ]
    return tuple(
        PlateLoad(plate.number, plate.time - delay, force)
        for plate, delay, force in zip(plates, lab.delays_s, forces, strict=True)
    )


def _predicted(model: InertiaModel, acceleration: Array, normal: Array) -> Array:
    """Predict the force along a direction of the plate, (N,); NaN where the acceleration is."""
    gain = model.gain[:, :3] @ normal
    return np.asarray(acceleration @ gain[:-1] + gain[-1])
