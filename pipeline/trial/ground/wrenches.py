"""Ground: samples of plates, accelerometers, belts and platform to wrenches of every plate."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np

from compensation import InertiaModel, PlatformPose, check_trial
from compensation.inertia.model_error import SLOW_HZ
from hbm.notes import Note
from hbm.signals.filtering import Method
from hbm.signals.resampling import interpolate, resample, resample_in_real_time
from hbm.spatial import Array, Mask
from pipeline.io.input_file import naming
from pipeline.io.recording import Plate, Recording
from pipeline.trial.ground.accelerometers import at_plate_times, hold_ends, mean_belt_speed
from pipeline.trial.ground.belts import belt_wrenches
from pipeline.trial.ground.calibration_recording import FILTER, samples_of, setup_of
from pipeline.trial.ground.corrected_plates import relative_delays_s
from pipeline.trial.ground.laboratory import BoundLaboratory, Laboratory, bind
from pipeline.trial.ground.platform import (
    LEVEL,
    NEUTRAL_FRAMES,
    in_lab,
    plate_marker_delay,
    plates_note,
    platform_pose,
    received_frames,
)
from pipeline.trial.ground.uncertainty import (
    Spread,
    sum_deviation,
    uncertainty_limits,
    wrench_spread,
)


def plate_artefacts(
    recording: Recording, laboratory: Laboratory
) -> tuple[list[Array], tuple[Note, ...]]:
    """Predict what the platform's motion and accelerating belts add to each plate.

    The laboratory has the calibration of its platform, its belts, or both. Per plate at its own
    samples, in its own moving frame about the centre of its surface, (N, 6) [N, N·m]; the notes say
    what is doubtful about calibration and trial. The accelerations are not low-passed; those of the
    belts are, as their model requires. A ValueError where the calibration does not fit the trial, a
    channel is missing, or the prediction is unknown within the trial or for more than 0.5 s at one
    of its ends.
    """
    plates, treadmill = recording.plates, laboratory.treadmill
    times = [plate.time for plate in plates]
    added: list[tuple[list[Array], str]] = []
    notes: list[Note] = []
    if laboratory.calibration is not None:
        lab = bind(recording, laboratory)
        late = relative_delays_s(plates, laboratory.plates)
        felt = _felt_unfiltered(lab, [t - late_s for t, late_s in zip(times, late, strict=True)])
        predicted = [_predicted(model, one) for model, one in zip(lab.models, felt, strict=True)]
        added.append((predicted, "the acceleration"))
        notes = [*laboratory.calibration.notes, *sensor_notes(lab)]
    if laboratory.belts and treadmill.belt is not None:
        of_belts = belt_wrenches(recording, laboratory.belts, treadmill.belt, times)
        added.append((of_belts, "the belts' acceleration"))
    artefacts = [np.zeros((len(time), 6)) for time in times]
    for wrenches, what in added:
        for artefact, time, wrench in zip(artefacts, times, wrenches, strict=True):
            with naming(recording.source):
                artefact += hold_ends(time, wrench, what)
    return artefacts, tuple(notes)


def sensor_notes(
    lab: BoundLaboratory,
    check: Callable[[InertiaModel, Array, float], tuple[Note, ...]] = check_trial,
) -> tuple[Note, ...]:
    """Say what is doubtful about a trial's accelerations, or what another check finds in them."""
    assert lab.readings is not None
    readings = lab.readings[1]
    seen = samples_of(readings, np.isfinite(readings).all(axis=1))
    return check(lab.models[0], seen, lab.laboratory.treadmill.accelerometer_range_g)


def _felt_unfiltered(lab: BoundLaboratory, times: Sequence[Array]) -> list[Array]:
    """Give the accelerations at plates' times: readings unfiltered, differences filtered."""
    assert lab.readings is not None
    assert lab.filtered is not None
    felt = at_plate_times(*lab.readings, times, lab.sensor_delays_s)
    if not lab.lags_s:
        return felt
    filtered = at_plate_times(*lab.filtered, times, lab.sensor_delays_s, lab.lags_s)
    both = zip(felt, filtered, strict=True)
    return [np.hstack([one, other[:, one.shape[1] :]]) for one, other in both]


def _predicted(model: InertiaModel, felt: Array) -> Array:
    """Predict the wrench that a platform's motion adds, (N, 6); NaN where it is unknown."""
    return np.asarray(felt @ model.gain[:-1] + model.gain[-1])


@dataclass(frozen=True, slots=True, eq=False)
class Ground:
    """The wrenches of the plates on the subject.

    Attributes
    ----------
    plates
        As recorded, corrected.
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
    accelerations
        Per plate what the accelerometers felt at the markers' times, as its inertia model takes it,
        (T, K) [m/s²]; empty without a calibration of the platform.
    belts
        Per plate what was subtracted of its accelerating belt, in the plate's own axes, (T, 6)
        [N, N·m]; empty without a calibration of the belts.
    notes
        How the wrenches were compensated and brought to the lab, and what is doubtful about that.
    """

    plates: Sequence[Plate]
    in_plates: Mapping[str, Sequence[Array]]
    variants: Mapping[str, Sequence[Array]]
    pose: PlatformPose | None
    spreads: tuple[Spread, ...] = ()
    correlation: Array = field(default_factory=lambda: np.zeros((0, 0)))
    accelerations: tuple[Array, ...] = ()
    belts: tuple[Array, ...] = ()
    notes: tuple[Note, ...] = ()

    @property
    def best(self) -> str:
        """The variant that is closest to the truth: the last one."""
        return [*self.variants][-1]

    @property
    def known(self) -> Mask:
        """Frames in which every plate of every variant is known, (T,)."""
        every = np.stack([wrench for each in self.variants.values() for wrench in each])
        return np.asarray(np.isfinite(every).all(axis=(0, 2)))

    def uncertainty(self, pelvis: Array) -> Array | None:
        """Give what the compensation makes uncertain of residuals about the pelvis, (T, 3) [m].

        One standard deviation, (T, 6) [N, N·m].
        """
        return sum_deviation(self.spreads, self.correlation, pelvis) if self.spreads else None


def ground_wrenches(
    lab: BoundLaboratory,
    time: Array,
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
    at_markers = resample_in_real_time if live else resample
    times = [time + delay_s for delay_s in lab.delays_s]
    measured = [
        at_markers(p.time, p.wrench_in_plate, t) for p, t in zip(plates, times, strict=True)
    ]

    variants, felt, added = {"measured": measured}, list[Array](), list[Array]()
    notes = list[Note]()
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
        added = belt_wrenches(recording, laboratory.belts, belt, times, method)
        shaken = variants.get("compensated", measured)
        variants["compensated"] = [w - own for w, own in zip(shaken, added, strict=True)]
        notes.append(Note.of("belts_compensated", channels=belt.speed_channels))

    pose, pose_notes = platform_pose(recording, platform, time, at_markers)
    notes += pose_notes
    marked = pose is not None and platform is not None and bool(platform.markers)
    if pose is None and lab.models:
        notes.append(Note.of("platform_pose", source=LEVEL))
    if live and marked:
        later = (np.cumsum(received_frames(recording)) > NEUTRAL_FRAMES)[:, None]
        variants = {
            name: [np.where(later, wrench, np.nan) for wrench in wrenches]
            for name, wrenches in variants.items()
        }
    if marked and lab.models:
        assert pose is not None
        readings = felt[0][:, : len(lab.models[0].acceleration_mean)]
        late = plate_marker_delay(pose, readings, recording.markers.rate_hz)
        notes += plates_note(late, lab.delays_s[0])
    belts_mps = None if lab.belts is None else interpolate(*lab.belts, times[0])
    rates_hz = cutoff_hz, recording.markers.rate_hz
    return Ground(
        plates=plates,
        in_plates=variants,
        variants={name: in_lab(wrenches, plates, pose) for name, wrenches in variants.items()},
        pose=pose,
        spreads=tuple(
            wrench_spread(model, acceleration, plate, pose, *rates_hz, belts_mps)
            for model, plate, acceleration in zip(lab.models, plates, felt, strict=False)
        ),
        correlation=lab.correlation,
        accelerations=tuple(felt),
        belts=tuple(added),
        notes=tuple(notes),
    )


def _compensation_notes(lab: BoundLaboratory, method: Method) -> list[Note]:
    """Say how plates were compensated by accelerometers, and what is doubtful about it."""
    treadmill, calibration = lab.laboratory.treadmill, lab.laboratory.calibration
    assert calibration is not None
    low_pass = (
        f"with plates low-passed as in the calibration ({FILTER}, {treadmill.cutoff_hz:g} Hz)"
    )
    how = Note.of(
        "plates_compensated",
        model="dynamic" if lab.lags_s else "static",
        accelerometers=tuple(treadmill.accelerometers),
        low_pass="in real time, without a low-pass before" if method == "realtime" else low_pass,
        delay_s={sensor.name: sensor.correction_s for sensor in lab.sensors},
    )
    limits = uncertainty_limits(mean_belt_speed(lab.belts), calibration)
    return [*calibration.notes, *sensor_notes(lab), how, *limits, *lab.laboratory.notes]


def _compensated(model: InertiaModel, acceleration: Array, wrench: Array) -> Array:
    """Compensate the samples that have both; the others stay gaps."""
    known = np.isfinite(acceleration).all(axis=1) & np.isfinite(wrench).all(axis=1)
    result = np.full(wrench.shape, np.nan)
    result[known] = model.compensate(acceleration[known], wrench[known])
    return result


class PlateLoad(NamedTuple):
    """The load on one plate.

    Attributes
    ----------
    number
        The plate's number in the file.
    time
        Of its samples, on the markers' clock, (N,) [s].
    force
        Normal to its surface, on the subject, (N,) [N]; NaN where unknown.
    """

    number: int
    time: Array
    force: Array

    @property
    def step_s(self) -> float:
        """Time from one sample to the next."""
        return float(self.time[-1] - self.time[0]) / (len(self.time) - 1)


def plate_loads(lab: BoundLaboratory) -> tuple[PlateLoad, ...]:
    """Give the load on every plate, without what the platform's motion adds where that is known.

    The plates' samples stay unfiltered: a low-pass would begin contact early. The prediction that
    is subtracted from them is of accelerations that pass the calibration's low-pass. Accelerating
    belts add moments only.
    """
    plates = lab.recording.plates
    forces = [plate.wrench_in_plate[:, :3] @ plate.rotation[2] for plate in plates]
    if lab.filtered is not None:
        times = [plate.time for plate in plates]
        felt = at_plate_times(*lab.filtered, times, lab.sensor_delays_s, lab.lags_s)
        for k, (model, plate) in enumerate(zip(lab.models, plates, strict=True)):
            gain = model.gain[:, :3] @ plate.rotation[2]
            forces[k] = forces[k] - (felt[k] @ gain[:-1] + gain[-1])
    return tuple(
        PlateLoad(plate.number, plate.time - delay, force)
        for plate, delay, force in zip(plates, lab.delays_s, forces, strict=True)
    )
