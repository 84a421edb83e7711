"""Ground: samples of plates, accelerometers, belts and platform to wrenches of every plate.

How uncertain compensated wrenches are, too. It is that of the compensation alone: noise of plates
and accelerometers, what the calibration's model does not explain of motion and belt speed like the
trial's, the uncertainty of its gains, and the zero of the plates. Body, markers, the platform's
pose and accelerating belts are not in it.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Final, NamedTuple

import numpy as np

from compensation import Calibration, InertiaModel, PlatformPose, check_trial
from compensation.inertia.model_error import RUNNING_MPS, SLOW_HZ
from hbm.notes import Note
from hbm.numbers import read_numbers
from hbm.signals.filtering import Method
from hbm.signals.resampling import interpolate, resample, resample_in_real_time
from hbm.spatial import WRENCH_COMPONENTS, Array, Mask, transform_wrench
from pipeline.io.input_file import naming
from pipeline.io.recording import Plate
from pipeline.trial.ground.accelerometers import hold_ends, mean_belt_speed, without_gaps
from pipeline.trial.ground.belts import belt_wrenches
from pipeline.trial.ground.laboratory import BELTS_UNKNOWN, BESIDE, BoundLaboratory
from pipeline.trial.ground.platform import LEVEL, after_neutral, in_lab, plates_note, platform_pose

LIMITS: Final = read_numbers("pipeline.trial", "thresholds.toml", "wrenches")


def plate_artefacts(lab: BoundLaboratory) -> tuple[list[Array], tuple[Note, ...]]:
    """Predict what the platform's motion and accelerating belts add to each plate.

    The laboratory has the calibration of its platform, its belts, or both. Per plate at its own
    samples, in its own moving frame about the centre of its surface, (N, 6) [N, N·m]; the notes say
    what is doubtful about calibration and trial. The accelerations are not low-passed; those of the
    belts are, as their model requires. A ValueError where the calibration does not fit the trial, a
    channel is missing, or the prediction is unknown within the trial or for more than 0.5 s at one
    of its ends.
    """
    recording, laboratory = lab.recording, lab.laboratory
    times = [plate.time for plate in recording.plates]
    artefacts, notes = [np.zeros((len(time), 6)) for time in times], tuple[Note, ...]()

    def add(wrenches: Sequence[Array], what: str) -> None:
        for artefact, time, wrench in zip(artefacts, times, wrenches, strict=True):
            with naming(recording.source):
                artefact += hold_ends(time, wrench, what)

    if laboratory.calibration is not None:
        readings = lab.accelerations(times, low_passed=False)
        # inertia: gain times specific force, and an offset
        predicted = [
            channels @ model.gain[:-1] + model.gain[-1]
            for model, channels in zip(lab.models, readings, strict=True)
        ]
        add(predicted, "the acceleration")
        notes = *laboratory.calibration.notes, *sensor_notes(lab)
    if laboratory.belts and (belt := laboratory.treadmill.belt) is not None:
        add(belt_wrenches(recording, laboratory.belts, belt, times), "the belts' acceleration")
    return artefacts, notes


def sensor_notes(
    lab: BoundLaboratory,
    check: Callable[[InertiaModel, Array, float], tuple[Note, ...]] = check_trial,
) -> tuple[Note, ...]:
    """Say what is doubtful about a trial's accelerations, or what another check finds in them."""
    assert lab.readings is not None
    (readings,) = without_gaps(lab.readings[1])
    return check(lab.models[0], readings, lab.laboratory.treadmill.accelerometer_range_g)


class Spread(NamedTuple):
    """One standard deviation of a plate's compensated wrench, due to the compensation alone.

    Attributes
    ----------
    sd
        Of its components without the plate's zero, in the plate's axes about its centre, (T, 6)
        [N, N·m]; NaN where the acceleration is unknown.
    zero
        Of its zero, the same in all frames, (6,) [N, N·m].
    rotation, center
        Orientation and place of the plate in the lab, (T, 3, 3) and (T, 3) [m], or (1, 3, 3) and
        (1, 3) where it stands still.
    """

    sd: Array
    zero: Array
    rotation: Array
    center: Array


def sum_deviation(spreads: Sequence[Spread], correlation: Array, point: Array) -> Array:
    """Give one standard deviation of the sum of some plates' wrenches, in lab axes, (T, 6).

    The correlation is between all of their components but the zeros, which are independent,
    (6 P, 6 P); moments are about a point in the lab, (T, 3) or (3,) [m]. NaN where an acceleration,
    the pose or the point is unknown.
    """
    # how each component in the plate's axes adds to the wrench in the lab about the point
    changes = [
        transform_wrench(np.eye(6), s.rotation[:, None], (s.center - point)[:, None]).T
        for s in spreads
    ]
    variance = np.empty((6, len(spreads[0].sd)))
    for row, of_row in enumerate(variance):
        both = [(change[row], spread) for change, spread in zip(changes, spreads, strict=True)]
        # variance of a sum: a^T C a of all components of all plates
        moving = np.concatenate([factors * spread.sd.T for factors, spread in both])
        of_row[:] = (moving * (correlation @ moving)).sum(axis=0)
        # zeros are independent of each other
        of_row += sum(spread.zero**2 @ factors**2 for factors, spread in both)
    return np.sqrt(variance).T


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
        Per plate what the accelerometers measure at the markers' times, as its inertia model takes
        it, (T, K) [m/s²]; empty without a calibration of the platform.
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
    spreads: tuple[Spread, ...]
    correlation: Array
    accelerations: tuple[Array, ...]
    belts: tuple[Array, ...]
    notes: tuple[Note, ...]

    @property
    def best(self) -> str:
        """The variant that is closest to the truth: the last one."""
        return [*self.variants][-1]

    @property
    def known(self) -> Mask:
        """Frames in which every plate of every variant is known, (T,)."""
        every = np.stack([wrench for of_plates in self.variants.values() for wrench in of_plates])
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
        their neutral places, which takes 100 frames.

    Raises
    ------
    ValueError
        If a channel or platform marker is missing.
    """
    recording, laboratory, plates = lab.recording, lab.laboratory, lab.recording.plates
    platform, belt = laboratory.treadmill.platform, laboratory.treadmill.belt
    live = method == "realtime"
    at_markers = resample_in_real_time if live else resample
    # plates are read later by as much as they are late
    times = [time + delay_s for delay_s in lab.delays_s]
    measured = [
        at_markers(p.time, p.wrench_in_plate, t) for p, t in zip(plates, times, strict=True)
    ]

    variants, accelerations, added = {"measured": measured}, list[Array](), list[Array]()
    notes = list[Note]()
    if lab.models:
        plain, accelerations = measured, lab.accelerations(times, method)
        if not live:
            # both pass the low-pass of the calibration: filtering only one of them would leave
            # the part of the artefact that the filter takes from the other
            plain = [
                resample(p.time, lab.setup.low_pass(p.wrench_in_plate, p.time), t)
                for p, t in zip(plates, times, strict=True)
            ]
        # in the plate's own frame, in which plates and accelerometers measure
        variants["compensated"] = list(map(_compensated, lab.models, accelerations, plain))
        notes += _compensation_notes(lab, method)
    if laboratory.belts and belt is not None:
        added = belt_wrenches(recording, laboratory.belts, belt, times, method)
        # belts shake the plates beside what the platform adds
        shaken = variants.get("compensated", measured)
        variants["compensated"] = [w - of_belt for w, of_belt in zip(shaken, added, strict=True)]
        notes.append(Note.of("belts_compensated", channels=belt.speed_channels))

    pose, pose_notes = platform_pose(recording, platform, time, at_markers)
    notes += pose_notes
    if pose is None and lab.models:
        notes.append(Note.of("platform_pose", source=LEVEL))
    if pose is not None and platform is not None and platform.markers:
        if live:
            # in real time the pose is known once the neutral places are
            later = after_neutral(recording)
            variants = {
                name: [np.where(later[:, None], wrench, np.nan) for wrench in wrenches]
                for name, wrenches in variants.items()
            }
        if lab.models:
            readings = accelerations[0][:, : len(lab.models[0].acceleration_mean)]
            notes += plates_note(pose, readings, recording.markers.rate_hz, lab.delays_s[0])
    belts_mps = None if lab.belts is None else interpolate(*lab.belts, times[0])
    # up to 6 Hz the noise is that below 6 Hz, else all that passed the calibration's filter, which
    # is more than what is left
    slow, rate_hz = cutoff_hz <= SLOW_HZ, recording.markers.rate_hz
    spreads = [
        Spread(
            sd=model.uncertainty(channels, slow, rate_hz, zero=False, belts_mps=belts_mps),
            zero=np.zeros(6) if model.model_error is None else model.model_error.zero,
            rotation=plate.rotation[None] if pose is None else pose.rotation @ plate.rotation,
            center=plate.center[None] if pose is None else pose.to_lab(plate.center),
        )
        for model, plate, channels in zip(lab.models, plates, accelerations, strict=False)
    ]
    return Ground(
        plates=plates,
        in_plates=variants,
        variants={name: in_lab(wrenches, plates, pose) for name, wrenches in variants.items()},
        pose=pose,
        spreads=tuple(spreads),
        correlation=lab.correlation,
        accelerations=tuple(accelerations),
        belts=tuple(added),
        notes=tuple(notes),
    )


def _compensation_notes(lab: BoundLaboratory, method: Method) -> list[Note]:
    """Say how plates were compensated by accelerometers, and what is doubtful about it."""
    calibration, setup = lab.laboratory.calibration, lab.setup
    assert calibration is not None
    low_pass = "in real time, without a low-pass before"
    if method != "realtime":
        cutoff = f"{setup.filter_method}, {setup.cutoff_hz:g} Hz"
        low_pass = f"with plates low-passed as in the calibration ({cutoff})"
    how = Note.of(
        "plates_compensated",
        model="dynamic" if lab.lags_s else "static",
        accelerometers=setup.sensors,
        low_pass=low_pass,
        delay_s={sensor.name: sensor.correction_s for sensor in lab.sensors},
    )
    limits = uncertainty_limits(mean_belt_speed(lab.belts), calibration)
    return [*calibration.notes, *sensor_notes(lab), how, *limits, *lab.laboratory.notes]


def uncertainty_limits(speed: float | None, calibration: Calibration) -> tuple[Note, ...]:
    """Say where a calibration does not know what people, or belts as fast as a trial's, leave.

    The speed [m/s] is that of `mean_belt_speed`. Models of earlier versions, which know of noise
    alone, do not count.
    """
    errors = [model.model_error for model in calibration.in_use.values()]
    # models of earlier versions know of noise alone
    fastest = [error.fastest_mps for error in errors if error is not None]
    if not fastest:
        return ()
    slowest = min((mps for mps in fastest if mps is not None), default=np.inf)
    left_out, made = [], calibration.provenance
    if BESIDE not in made:
        left_out.append("what people shake (no recording of people beside an empty plate)")
    if None in fastest:
        recordings = made.get(BELTS_UNKNOWN, made.get("recording", "its recording"))
        left_out.append(f"belts faster than in {recordings}, whose speed is unknown")
    elif speed is None:
        left_out.append(f"belts faster than {slowest:.3g} m/s (no channel with their speed)")
    if calibration.correlation is None and len(calibration.plates) > 1:
        left_out.append("how the plates' errors go together (they were sampled at other times)")
    notes = [Note.of("uncertainty_limited", left_out=left_out)] if left_out else []
    if speed is not None and speed > max(LIMITS.faster_belts * slowest, RUNNING_MPS):
        values = {"speed_mps": speed, "calibrated_mps": slowest}
        notes.append(Note.of("uncertainty_belts_faster", **values))
    return tuple(notes)


def uncertainty_notes(residual_sd: Array) -> tuple[Note, ...]:
    """Say how uncertain residuals are due to the compensation, (T, 6); nothing for no frames."""
    if not len(residual_sd):
        return ()
    rms = dict(zip(WRENCH_COMPONENTS, np.sqrt(np.mean(residual_sd**2, axis=0)), strict=True))
    force = {component: rms[component] for component in WRENCH_COMPONENTS[:3]}
    moment = {component: rms[component] for component in WRENCH_COMPONENTS[3:]}
    return (Note.of("compensation_uncertainty", force_n=force, moment_nm=moment),)


def _compensated(model: InertiaModel, acceleration: Array, wrench: Array) -> Array:
    """Compensate the samples that have both; the others stay gaps."""
    has_both = np.isfinite(acceleration).all(axis=1) & np.isfinite(wrench).all(axis=1)
    result = np.full(wrench.shape, np.nan)
    result[has_both] = model.compensate(acceleration[has_both], wrench[has_both])
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
    if lab.models:
        accelerations = lab.accelerations([plate.time for plate in plates])
        for k, (model, plate) in enumerate(zip(lab.models, plates, strict=True)):
            # of the force alone, along the normal of the plate
            gain = model.gain[:, :3] @ plate.rotation[2]
            forces[k] = forces[k] - (accelerations[k] @ gain[:-1] + gain[-1])
    return tuple(
        PlateLoad(plate.number, plate.time - delay, force)
        for plate, delay, force in zip(plates, lab.delays_s, forces, strict=True)
    )
