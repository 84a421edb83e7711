"""What a recording of the empty treadmill shows beside its calibration: numbers and figures."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Final

import matplotlib as mpl
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from scipy.ndimage import median_filter, uniform_filter1d
from scipy.signal import find_peaks, peak_prominences, welch

from compensation import Calibration, PlatformPose, estimate_delay, specific_force
from compensation.inertia.model_error import RUNNING_MPS, SLOW_HZ
from hbm.signals.filtering import low_pass
from hbm.signals.resampling import resample
from hbm.spatial import WRENCH_COMPONENTS, Array, fit_rotation
from hbm.spelling import written
from pipeline.config.schema import Platform
from pipeline.figures.residuals import component_figure, legend_below
from pipeline.figures.style import COLOURS, PALETTE, STYLE
from pipeline.io.recording import Recording
from pipeline.trial.ground.accelerometers import accelerations, fastest_belt, mean_belt_speed
from pipeline.trial.ground.calibration_recording import plate_samples, setup_of
from pipeline.trial.ground.corrected_plates import with_corrected_plates
from pipeline.trial.ground.laboratory import Laboratory
from pipeline.trial.ground.platform import empty_pose, turned_rad
from pipeline.trial.ground.wrenches import plate_artefacts

SWAY: Final = "sway_m"
PITCH: Final = "pitch_deg"
"""Keys of a calibration's provenance: largest sway [m] and pitch [°] of its recording."""
SEGMENT_S: Final = 8.0
"""Of a spectrum: lines 0.125 Hz wide."""
AROUND_HZ: Final = 3.0
"""Width of the band whose median is the background of a line."""
LINE_HZ: Final = 0.4
"""Either side of a line: belts keep their speed to some per cent."""
LINE_FACTOR: Final = 10.0
"""Of the background, above which a line is one of the rollers."""
ROLLER_M: Final = (0.03, 0.15)
"""Smallest and largest radius of a treadmill's rollers."""
BASE_HZ: Final = (7.0, 60.0)
"""Above commanded motion; below the modes of load cells."""
BASE_FACTOR: Final = 1.2
"""Of the power of a broad peak over the valleys beside it, mean over all components."""
SMOOTH_HZ: Final = 2.0
"""Over which spectra are smoothed for broad peaks: lines of rollers and drives go."""
PLACE_HZ: Final = 3.0
"""Low-pass for the places of accelerometers: markers differentiated twice are noise above."""
MIN_PITCH_RAD: Final = np.radians(1.0)
"""Below, a platform does not pitch: markers and commands are not exact to less."""
SHOWN_S: Final = 30.0
"""Of a recording, around its largest load: a period of pitch, six pulses of the belts."""
SHOWN_SAMPLES: Final = 3000


@dataclass(frozen=True, slots=True)
class Spectrum:
    """Amplitude densities of a plate before and after compensation, (F, 6) [N/√Hz, N·m/√Hz]."""

    frequency_hz: Array
    before: Array
    after: Array


@dataclass(frozen=True, slots=True)
class Sources:
    """RMS below 6 Hz of what remains on a plate by source, (6,) [N, N·m]; None where unknown.

    Other: all of it less base and rollers, in squares. People: in recordings of people, beside it.
    """

    base: Array | None = None
    rollers: Array | None = None
    other: Array | None = None
    people: Array | None = None


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
        Its plates corrected.
    rate_hz
        Of the plates [Hz].
    before, after
        Plate -> wrench through the calibration's low-pass, in its own axes, (N, 6) [N, N·m].
    spectra
        Plate -> spectrum without any filter.
    low, high
        Range of the accelerometers' channels, (k,) [m/s²].
    belts_mps
        Speed of the belts [m/s]; None where unknown.
    rollers_hz
        Frequency of the rollers [Hz]; None where no line shows it.
    base_hz
        Frequencies of the base [Hz].
    sources
        Plate -> remaining RMS by source.
    places
        Accelerometer -> its place; empty where the pose of the platform is unknown.
    sway_m, pitch_deg
        Largest of the platform; None where its pose is unknown.
    """

    recording: Recording
    rate_hz: float
    before: Mapping[str, Array]
    after: Mapping[str, Array]
    spectra: Mapping[str, Spectrum]
    low: Array
    high: Array
    belts_mps: float | None
    rollers_hz: float | None
    base_hz: tuple[float, ...]
    sources: Mapping[str, Sources]
    places: Mapping[str, Place]
    sway_m: float | None
    pitch_deg: float | None

    @property
    def front_is_known(self) -> bool:
        """Whether the axes were stated; an empty treadmill does not show which end is its front."""
        return bool(self.recording.axes)

    @property
    def motion(self) -> dict[str, str]:
        """Largest sway and pitch, for the provenance of a calibration; empty where unknown."""
        if self.sway_m is None or self.pitch_deg is None:
            return {}
        return {SWAY: f"{self.sway_m:.4f}", PITCH: f"{self.pitch_deg:.2f}"}


def measure_empty(
    recording: Recording,
    laboratory: Laboratory,
    beside: Sequence[Recording] = (),
    platform: Platform | None = None,
) -> EmptyTreadmill:
    """Compensate a recording of the empty treadmill, and find what remains by source.

    Parameters
    ----------
    recording
        As it was read.
    laboratory
        With its calibration.
    beside
        Recordings of people beside an empty plate.
    platform
        How the platform's pose is known; else by channels named sway and pitch.

    Returns
    -------
    EmptyTreadmill
        Base: expected of the platform's motion in this recording, by the calibration's
        `ModelError`; people: of the largest motion in those of people. Rollers: power of the line
        at their frequency and its harmonics, less the background.

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
    artefacts, _ = plate_artefacts(recording, laboratory)
    spectra = {}
    for plate, artefact in zip(recording.plates, artefacts, strict=True):
        wrench = plate.wrench_in_plate
        is_known = np.isfinite(wrench).all(axis=1)
        name = f"plate {plate.number}"
        spectra[name] = _spectrum(wrench[is_known], (wrench - artefact)[is_known], rate_hz)
    belts_mps = mean_belt_speed(fastest_belt(recording, treadmill))
    rollers_hz = _rollers(list(spectra.values()), belts_mps)
    moving = _of_motion(calibration, samples, rate_hz)
    people: dict[str, Array] = {}
    for other in beside:
        corrected = with_corrected_plates(other, laboratory.plates)
        of_people = plate_samples(corrected, treadmill, calibration.sensors, laboratory.plates, ())
        for name, rms in _of_motion(calibration, of_people, rate_hz).items():
            people[name] = np.maximum(rms, people.get(name, 0.0))
    sources = {}
    for name, remaining in after.items():
        slow = low_pass(remaining, rate_hz, SLOW_HZ, "zero_phase")
        rollers = None if rollers_hz is None else _line_rms(slow, rate_hz, rollers_hz)
        rest = slow.var(axis=0) - sum(
            part**2 for part in (moving.get(name), rollers) if part is not None
        )
        other = np.sqrt(np.maximum(rest, 0.0))
        sources[name] = Sources(moving.get(name), rollers, other, people.get(name))
    setup = setup_of(recording, treadmill)
    clock, readings = accelerations(recording, treadmill)
    felt = setup.low_pass(readings, clock)
    pose, places = empty_pose(recording, platform), dict[str, Place]()
    if pose is not None:
        is_known = np.isfinite(pose.position).all(axis=1)
        pose = PlatformPose(pose.rotation[is_known], pose.position[is_known])
        times = recording.markers.time[is_known]
        rate = recording.markers.rate_hz
        places = _places(times, rate, pose, clock, readings, setup.sensors)
    return EmptyTreadmill(
        recording,
        rate_hz,
        before,
        after,
        spectra,
        np.nanmin(felt, axis=0),
        np.nanmax(felt, axis=0),
        belts_mps,
        rollers_hz,
        _base(list(spectra.values())),
        sources,
        places,
        None if pose is None else float(np.abs(pose.position @ _axis(pose)).max()),
        None if pose is None else float(np.degrees(turned_rad(pose).max())),
    )


def _of_motion(
    calibration: Calibration, samples: Mapping[str, tuple[Array, Array]], rate_hz: float
) -> dict[str, Array]:
    """Give the RMS below 6 Hz that a recording's motion lets expect, plate -> (6,)."""
    found = {}
    for name, (felt, _) in samples.items():
        model = calibration.in_use.get(name)
        if model is None or model.model_error is None or not len(model.model_error.directions):
            continue
        error, k = model.model_error, len(model.acceleration_mean)
        variance = error.variance(felt[:, :k], rate_hz, slow=True, belts_mps=0.0).mean(axis=0)
        found[name] = np.sqrt(np.maximum(variance - error.floor[1], 0.0))
    return found


def _density(signal: Array, rate_hz: float) -> tuple[Array, Array]:
    length = min(round(SEGMENT_S * rate_hz), len(signal))
    frequency, power = welch(signal, rate_hz, nperseg=length, axis=0)
    return frequency, power


def _spectrum(before: Array, after: Array, rate_hz: float) -> Spectrum:
    (frequency, first), (_, second) = (_density(each, rate_hz) for each in (before, after))
    return Spectrum(frequency, np.sqrt(first), np.sqrt(second))


def _background(power: Array, frequency: Array) -> Array:
    """Give the median of the frequencies around each, (F, 6)."""
    width = max(round(AROUND_HZ / (frequency[1] - frequency[0])), 3)
    return np.asarray(median_filter(power, size=(width, 1), mode="nearest"))


def _rollers(spectra: Sequence[Spectrum], belts_mps: float | None) -> float | None:
    """Find the line of unbalanced rollers, at a turn for each circumference of the belt's way."""
    if belts_mps is None or belts_mps < RUNNING_MPS:
        return None
    slowest, fastest = (belts_mps / (2 * np.pi * radius) for radius in reversed(ROLLER_M))
    frequency = spectra[0].frequency_hz
    inside = (frequency >= slowest) & (frequency <= fastest)
    if not inside.any():
        return None
    excess = np.max(
        [s.after**2 / np.maximum(_background(s.after**2, frequency), 1e-12) for s in spectra],
        axis=(0, 2),
    )
    peak = int(np.argmax(np.where(inside, excess, 0.0)))
    return float(frequency[peak]) if excess[peak] > LINE_FACTOR else None


def _line_rms(slow: Array, rate_hz: float, line_hz: float) -> Array:
    """Give the RMS of a line and its harmonics, less the background, (6,)."""
    frequency, power = _density(slow, rate_hz)
    excess = np.maximum(power - _background(power, frequency), 0.0)
    ratio = frequency / line_hz
    near = (np.abs(ratio - np.round(ratio)) * line_hz < LINE_HZ) & (ratio > 0.5)
    return np.asarray(np.sqrt(excess[near].sum(axis=0) * (frequency[1] - frequency[0])))


def _base(spectra: Sequence[Spectrum]) -> tuple[float, ...]:
    """Find the broad peaks of what remains, at most two, where the base vibrates."""
    frequency = spectra[0].frequency_hz
    every = np.hstack([np.log(np.maximum(s.after**2, 1e-12)) for s in spectra])
    step = frequency[1] - frequency[0]
    width = max(round(SMOOTH_HZ / step), 3)
    smooth = uniform_filter1d(median_filter(every, size=(width, 1)).mean(axis=1), width)
    inside = np.flatnonzero((frequency >= BASE_HZ[0]) & (frequency <= BASE_HZ[1]))
    if len(inside) < 3:
        return ()
    peaks, _ = find_peaks(smooth[inside], prominence=np.log(BASE_FACTOR), plateau_size=1)
    order = np.argsort(-peak_prominences(smooth[inside], peaks)[0])
    found = [float(frequency[inside[peak]]) for peak in peaks[order]]
    return tuple(sorted(found[:2]))


def _axis(pose: PlatformPose) -> Array:
    """Give the axis of pitch, along which the platform sways, (3,), in any axes of the file."""
    skew = pose.rotation - np.swapaxes(pose.rotation, 1, 2)
    turn = skew[:, [2, 0, 1], [1, 2, 0]]
    vectors = turn if np.abs(turn).max() > 2 * MIN_PITCH_RAD else pose.position
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
    if len(time) < rate_hz or turned_rad(pose).max() < MIN_PITCH_RAD:
        return {}
    force = low_pass(specific_force(pose, rate_hz), rate_hz, PLACE_HZ, "zero_phase")
    slow = low_pass(readings, clock, PLACE_HZ, "zero_phase")
    back = np.swapaxes(pose.rotation, 1, 2) @ np.gradient(pose.rotation, 1 / rate_hz, axis=0)
    speed = back[:, [2, 0, 1], [1, 2, 0]] @ axis
    speed = low_pass(speed, rate_hz, PLACE_HZ, "zero_phase")
    felt = resample(clock, slow, time)
    inside = np.isfinite(felt).all(axis=1)
    try:
        late_s = estimate_delay(felt[inside], force[inside], rate_hz).seconds
    except ValueError:
        return {}
    felt = resample(clock, slow, time - late_s)
    inside = np.isfinite(felt).all(axis=1)
    design = np.column_stack([force[:, :3], force[:, 3:] @ axis, speed**2])[inside]
    forward = np.cross(axis, [0.0, 0.0, 1.0])
    forward *= np.sign(forward[np.argmax(np.abs(forward))]) or 1.0
    places = {}
    for sensor, measured in zip(sensors, np.split(felt[inside], len(sensors), axis=1), strict=True):
        gains = np.linalg.lstsq(design, measured)[0].T
        arm = np.cross(fit_rotation(gains[:, :3]).T @ gains[:, 3], axis)
        places[sensor] = Place(float(arm @ forward), float(arm[2]))
    return places


def time_figure(
    before: Array, predicted: Array, rate_hz: float, components: Sequence[str] = WRENCH_COMPONENTS
) -> Figure:
    """Draw what an empty plate measures, what is predicted, and what remains, (N, C) each."""
    size = np.linalg.norm(before - before.mean(axis=0), axis=1)
    count = min(round(SHOWN_S * rate_hz), len(size))
    start = int(np.clip(np.argmax(size) - count // 2, 0, len(size) - count))
    shown = slice(start, start + count, max(count // SHOWN_SAMPLES, 1))
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
    inside = (frequency > 0.2) & (frequency <= BASE_HZ[1])
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
        panel.set_xlim(0.2, BASE_HZ[1])
        panel.yaxis.set_major_formatter("{x:g}")
        panel.set_xticks([0.2, 1, 6, 20, 60], ["0.2", "1", "6", "20", "60"])
        panel.minorticks_off()
        panel.set_xlabel("frequency (Hz)")

    return component_figure(WRENCH_COMPONENTS, draw, "/√Hz")


def plan_figure(empty: EmptyTreadmill) -> Figure:
    """Draw plates, markers and accelerometers from above, as the file and the readings say.

    The belts are upright; the front is above where the axes are stated, and else either end.
    """
    markers, plates = empty.recording.markers, empty.recording.plates
    corners = np.array([plate.corners for plate in plates])
    length, width = np.ptp(corners[0], axis=0)[:2]
    lengthwise = empty.front_is_known or length >= width
    along, across = ((0, 1.0), (1, 1.0)) if lengthwise else ((1, 1.0), (0, -1.0))

    def place(points: Array) -> tuple[Array, Array]:
        return across[1] * points[..., across[0]], along[1] * points[..., along[0]]

    with mpl.rc_context(STYLE):
        figure = Figure(figsize=(9, 5.5), layout="constrained")
        panel = figure.subplots()
        for plate, edge in zip(plates, corners, strict=True):
            panel.fill(*place(edge), color="#e8ecef", ec="#56616b", lw=1)
            x, y = map(float, place(plate.center))
            panel.annotate(f"plate {plate.number}", (x, y), ha="center")
        for k, name in enumerate(markers.names):
            seen = markers.position[:, k]
            seen = seen[np.isfinite(seen).all(axis=1)]
            if len(seen):
                x, y = map(float, place(np.median(seen, axis=0)))
                panel.plot(x, y, "o", color=PALETTE[0], ms=5)
                panel.annotate(name, (x, y), (4, 4), textcoords="offset points", fontsize=7)
        for name, at in empty.places.items():
            panel.axhline(at.along, color=PALETTE[1], ls="--", lw=1)
            panel.annotate(
                f"{name}: {at}",
                (0.01, at.along),
                (0, 3),
                xycoords=panel.get_yaxis_transform(),
                textcoords="offset points",
                color=PALETTE[1],
                fontsize=8,
            )
        panel.set_aspect("equal", adjustable="datalim")
        panel.invert_xaxis()
        panel.set_xlabel("across the belts (m)")
        panel.set_ylabel(f"along the belts{', to the front' * empty.front_is_known} (m)")
    return figure


def range_figure(calibration: Calibration, others: Mapping[str, tuple[Array, Array]]) -> Figure:
    """Draw the range of each accelerometer channel in the calibration, and in other recordings."""
    model = next(iter(calibration.plates.values()))
    names = [f"{sensor} {axis}" for sensor in model.sensors for axis in "xyz"]
    with mpl.rc_context(STYLE):
        figure = Figure(figsize=(9, 1 + 0.36 * len(names)), layout="constrained")
        panel = figure.subplots()
        at, mean = np.arange(len(names)), model.acceleration_mean
        low, high = model.acceleration_low - mean, model.acceleration_high - mean
        panel.barh(at, high - low, left=low, height=0.7, color="#d9dee3", label="calibration")
        for n, (label, (least, most)) in enumerate(others.items()):
            place = at + (n - (len(others) - 1) / 2) * 0.6 / max(len(others), 1)
            ends, colour = (least - mean, most - mean), PALETTE[n % len(PALETTE)]
            panel.hlines(place, *ends, color=colour, lw=2.5, label=label)
        panel.set_yticks(at, names)
        panel.invert_yaxis()
        panel.set_xlabel("acceleration about the calibration's mean (m/s²)")
        legend_below(figure, panel)
    return figure
