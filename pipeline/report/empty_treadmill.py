"""What a recording of the empty treadmill shows beside its calibration: numbers and figures."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
import scipy
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from compensation import PlatformPose, estimate_delay, specific_force
from compensation.inertia.model_error import RUNNING_MPS, SLOW_HZ
from hbm.numbers import read_numbers
from hbm.signals.filtering import low_pass
from hbm.signals.resampling import resample
from hbm.spatial import WRENCH_COMPONENTS, Array, fit_rotation
from hbm.spelling import written
from pipeline.config.schema import Platform
from pipeline.figures.residuals import component_figure
from pipeline.figures.style import COLOURS, PALETTE
from pipeline.io.recording import Recording
from pipeline.trial.ground.accelerometers import (
    accelerations,
    fastest_belt,
    mean_belt_speed,
    setup_of,
)
from pipeline.trial.ground.calibrations import plate_samples
from pipeline.trial.ground.laboratory import Laboratory, bind, with_corrected_plates
from pipeline.trial.ground.platform import empty_pose, turned_rad
from pipeline.trial.ground.wrenches import plate_artefacts

SWAY: Final = "sway_m"
PITCH: Final = "pitch_deg"
"""Keys of a calibration's provenance: largest sway [m] and pitch [°] of its recording."""
LIMITS: Final = read_numbers("pipeline.report", "thresholds.toml", "vibration")
PLACE_HZ: Final = 3.0
"""Low-pass for the places of accelerometers: markers differentiated twice are noise above."""


@dataclass(frozen=True, slots=True)
class Spectrum:
    """Amplitude densities of a plate before and after compensation, (F, 6) [N/√Hz, N·m/√Hz]."""

    frequency_hz: Array
    before: Array
    after: Array


@dataclass(frozen=True, slots=True)
class Place:
    """Where an accelerometer is on the platform by its readings: along the belts and up [m]."""

    along: float
    up: float

    def __str__(self) -> str:
        along, up = written(self.along, "+.2f"), written(self.up, "+.2f")
        return f"{along} m along the belts, {up} m up"


@dataclass(frozen=True, slots=True, eq=False)
class EmptyTreadmill:
    """A recording of the empty treadmill with its plates compensated by a calibration.

    Attributes
    ----------
    recording
        Its plates corrected. Its axes are those that were stated: an empty treadmill does not show
        which end is its front.
    rate_hz
        Of the plates [Hz].
    before, after
        Plate -> wrench through the calibration's low-pass, in its own axes, (N, 6) [N, N·m].
    spectra
        Plate -> spectrum without any filter.
    belts_mps
        Speed of the belts [m/s]; None where unknown.
    rollers_hz
        Frequency of the rollers [Hz]; None where no line shows it.
    base_hz
        Frequencies of the base [Hz].
    places
        Accelerometer -> its place; empty where the pose of the platform is unknown.
    motion
        Largest sway and pitch, for the provenance of a calibration; empty where unknown.
    """

    recording: Recording
    rate_hz: float
    before: Mapping[str, Array]
    after: Mapping[str, Array]
    spectra: Mapping[str, Spectrum]
    belts_mps: float | None
    rollers_hz: float | None
    base_hz: tuple[float, ...]
    places: Mapping[str, Place]
    motion: Mapping[str, str]


def measure_empty(
    recording: Recording,
    laboratory: Laboratory,
    platform: Platform | None = None,
) -> EmptyTreadmill:
    """Compensate a recording of the empty treadmill, and find what shakes it.

    Parameters
    ----------
    recording
        As it was read.
    laboratory
        With its calibration.
    platform
        How the platform's pose is known; else by channels named sway and pitch.

    Returns
    -------
    EmptyTreadmill
        What is measured, what remains, and where the accelerometers are.

    Raises
    ------
    ValueError
        As of `plate_artefacts`.
    """
    calibration, treadmill = laboratory.calibration, laboratory.treadmill
    assert calibration is not None
    recording = with_corrected_plates(recording, laboratory.plates)
    lags_s = next((model.lags_s for model in calibration.dynamic.values()), ())
    samples = plate_samples(recording, treadmill, calibration.sensors, laboratory.plates, lags_s)
    rate_hz = setup_of(recording, treadmill).rate_hz
    before = {name: wrench for name, (_, wrench) in samples.items()}
    models = calibration.in_use
    after = {name: models[name].compensate(*of_plate) for name, of_plate in samples.items()}
    artefacts, _ = plate_artefacts(bind(recording, laboratory))
    spectra = {}
    for plate, artefact in zip(recording.plates, artefacts, strict=True):
        wrench = plate.wrench_in_plate
        is_known = np.isfinite(wrench).all(axis=1)
        name = f"plate {plate.number}"
        spectra[name] = _spectrum(wrench[is_known], (wrench - artefact)[is_known], rate_hz)
    belts_mps = mean_belt_speed(fastest_belt(recording, treadmill))
    rollers_hz = _rollers(list(spectra.values()), belts_mps)
    pose, places, motion = empty_pose(recording, platform), dict[str, Place](), dict[str, str]()
    if pose is not None:
        is_known = np.isfinite(pose.position).all(axis=1)
        pose = PlatformPose(pose.rotation[is_known], pose.position[is_known])
        times = recording.markers.time[is_known]
        rate, sensors = recording.markers.rate_hz, setup_of(recording, treadmill).sensors
        places = _places(times, rate, pose, *accelerations(recording, treadmill), sensors)
        sway_m = np.abs(pose.position @ _axis(pose)).max()
        motion = {SWAY: f"{sway_m:.4f}", PITCH: f"{np.degrees(turned_rad(pose).max()):.2f}"}
    return EmptyTreadmill(
        recording,
        rate_hz,
        before,
        after,
        spectra,
        belts_mps,
        rollers_hz,
        _base(list(spectra.values())),
        places,
        motion,
    )


def _spectrum(before: Array, after: Array, rate_hz: float) -> Spectrum:
    # segments of 8 s: lines are 0.125 Hz wide
    length = min(round(8.0 * rate_hz), len(before))
    both = np.stack([before, after])
    frequency, power = scipy.signal.welch(both, rate_hz, nperseg=length, axis=1)
    return Spectrum(frequency, *np.sqrt(power))


def _rollers(spectra: Sequence[Spectrum], belts_mps: float | None) -> float | None:
    """Find the line of unbalanced rollers, at a turn for each circumference of the belt's way."""
    if belts_mps is None or belts_mps < RUNNING_MPS:
        return None
    # a turn for each circumference, from that of the largest to that of the smallest roller
    slowest, fastest = (
        belts_mps / (2 * np.pi * radius) for radius in LIMITS.rollers[::-1].tolist()
    )
    frequency = spectra[0].frequency_hz
    inside = (frequency >= slowest) & (frequency <= fastest)
    if not inside.any():
        return None
    # power over the median of the 3 Hz around each frequency
    width = max(round(3.0 / (frequency[1] - frequency[0])), 3)
    power = np.stack([s.after**2 for s in spectra])
    background = scipy.ndimage.median_filter(power, size=(1, width, 1), mode="nearest")
    excess = np.max(power / np.maximum(background, 1e-12), axis=(0, 2))
    peak = int(np.argmax(np.where(inside, excess, 0.0)))
    return float(frequency[peak]) if excess[peak] > LIMITS.line_factor else None


def _base(spectra: Sequence[Spectrum]) -> tuple[float, ...]:
    """Find the broad peaks of what remains, at most two, where the base vibrates."""
    frequency = spectra[0].frequency_hz
    logarithms = np.hstack([np.log(np.maximum(s.after**2, 1e-12)) for s in spectra])
    step = frequency[1] - frequency[0]
    # a median over 2 Hz takes away the lines of rollers and drives, and leaves broad peaks
    width = max(round(2.0 / step), 3)
    smooth = scipy.ndimage.uniform_filter1d(
        scipy.ndimage.median_filter(logarithms, size=(width, 1)).mean(axis=1), width
    )
    inside = np.flatnonzero((frequency >= LIMITS.base[0]) & (frequency <= LIMITS.base[1]))
    if len(inside) < 3:
        return ()
    peaks, _ = scipy.signal.find_peaks(
        smooth[inside], prominence=np.log(LIMITS.base_factor), plateau_size=1
    )
    order = np.argsort(-scipy.signal.peak_prominences(smooth[inside], peaks)[0])
    peaks_hz = [float(frequency[inside[peak]]) for peak in peaks[order]]
    return tuple(sorted(peaks_hz[:2]))


def _axis(pose: PlatformPose) -> Array:
    """Give the axis of pitch, along which the platform sways, (3,), in any axes of the file."""
    # the skew part of a rotation matrix, R - R', is twice the sine of the angle about its axis
    skew = pose.rotation - np.swapaxes(pose.rotation, 1, 2)
    turn = skew[:, [2, 0, 1], [1, 2, 0]]
    pitches = np.abs(turn).max() > 2 * np.radians(LIMITS.least_pitch)
    vectors = turn if pitches else pose.position
    # the principal direction of all frames
    return np.asarray(np.linalg.eigh(vectors.T @ vectors)[1][:, -1])


def _places(
    time: Array,
    rate_hz: float,
    pose: PlatformPose,
    clock: Array,
    readings: Array,
    sensors: Sequence[str],
) -> dict[str, Place]:
    """Find where accelerometers are: pitch adds to readings in proportion to the distance.

    Sway and pitch do not show how far to the left one is. Empty where the platform hardly pitches.
    """
    axis = _axis(pose)
    if len(time) < rate_hz or turned_rad(pose).max() < np.radians(LIMITS.least_pitch):
        return {}
    force = low_pass(specific_force(pose, rate_hz), rate_hz, PLACE_HZ, "zero_phase")
    slow = low_pass(readings, clock, PLACE_HZ, "zero_phase")
    back = np.swapaxes(pose.rotation, 1, 2) @ np.gradient(pose.rotation, 1 / rate_hz, axis=0)
    speed = back[:, [2, 0, 1], [1, 2, 0]] @ axis
    speed = low_pass(speed, rate_hz, PLACE_HZ, "zero_phase")
    at_poses = resample(clock, slow, time)
    inside = np.isfinite(at_poses).all(axis=1)
    try:
        late_s = estimate_delay(at_poses[inside], force[inside], rate_hz).seconds
    except ValueError:
        return {}
    at_poses = resample(clock, slow, time - late_s)
    inside = np.isfinite(at_poses).all(axis=1)
    # specific force of the platform's origin, and what the lever adds: α × r and ω × (ω × r)
    design = np.column_stack([force[:, :3], force[:, 3:] @ axis, speed**2])[inside]
    forward = np.cross(axis, [0.0, 0.0, 1.0])
    forward *= np.sign(forward[np.argmax(np.abs(forward))]) or 1.0
    places = {}
    of_sensors = np.split(at_poses[inside], len(sensors), axis=1)
    for sensor, measured in zip(sensors, of_sensors, strict=True):
        gains = np.linalg.lstsq(design, measured)[0].T
        # the sensor may be turned in any way: its rotation is that of its gains to the force
        arm = np.cross(fit_rotation(gains[:, :3]).T @ gains[:, 3], axis)
        places[sensor] = Place(float(arm @ forward), float(arm[2]))
    return places


def time_figure(
    before: Array, predicted: Array, rate_hz: float, components: Sequence[str] = WRENCH_COMPONENTS
) -> Figure:
    """Draw what an empty plate measures, what is predicted, and what remains, (N, C) each."""
    size = np.linalg.norm(before - before.mean(axis=0), axis=1)
    # 30 s around the largest load: a period of pitch, six pulses of the belts
    count = min(round(30.0 * rate_hz), len(size))
    start = int(np.clip(np.argmax(size) - count // 2, 0, len(size) - count))
    shown = slice(start, start + count, max(count // 3000, 1))
    time = np.arange(len(size))[shown] / rate_hz
    lines = (
        ("before", before, COLOURS["measured"], 1.6),
        ("predicted", predicted, PALETTE[0], 0.7),
        ("after", before - predicted, COLOURS["compensated"], 0.7),
    )

    def draw(panel: Axes, k: int) -> None:
        for label, values, colour, width in lines:
            panel.plot(time, values[shown, k], color=colour, lw=width, label=label)
        panel.set_xlabel("time (s)")

    return component_figure(components, draw)


def spectrum_figure(spectrum: Spectrum, empty: EmptyTreadmill, cutoff_hz: float | None) -> Figure:
    """Draw a plate's spectra with the low-passes, and the frequencies of base and rollers."""
    frequency = spectrum.frequency_hz
    inside = (frequency > 0.2) & (frequency <= LIMITS.base[1])
    marks = [("trial filter, 6 Hz", SLOW_HZ, "black", "-")]
    if cutoff_hz is not None:
        marks.append((f"calibration filter, {cutoff_hz:g} Hz", cutoff_hz, "black", ":"))
    if empty.rollers_hz is not None:
        marks.append((f"rollers, {empty.rollers_hz:.2f} Hz", empty.rollers_hz, PALETTE[1], "--"))
    marks += [(f"base, {hz:.0f} Hz", hz, PALETTE[2], "-.") for hz in empty.base_hz]

    def draw(panel: Axes, k: int) -> None:
        panel.axvspan(0.2, SLOW_HZ, color="#f0f2f4", lw=0)
        lines = {"before": spectrum.before, "after": spectrum.after}
        for (label, values), colour in zip(lines.items(), COLOURS.values(), strict=True):
            panel.loglog(frequency[inside], values[inside, k], color=colour, lw=0.9, label=label)
        for label, hz, colour, dashes in marks:
            panel.axvline(hz, color=colour, ls=dashes, lw=0.9, label=label)
        panel.set_xlim(0.2, LIMITS.base[1])
        panel.yaxis.set_major_formatter("{x:g}")
        panel.set_xticks([0.2, 1, 6, 20, 60], ["0.2", "1", "6", "20", "60"])
        panel.minorticks_off()
        panel.set_xlabel("frequency (Hz)")

    return component_figure(WRENCH_COMPONENTS, draw, "/√Hz")
