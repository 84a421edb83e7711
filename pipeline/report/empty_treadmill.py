"""What a recording of the empty treadmill shows beside its calibration: numbers and figures."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
import scipy
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from compensation import PlatformPose
from compensation.inertia.model_error import SLOW_HZ
from hbm.spatial import WRENCH_COMPONENTS, Array
from pipeline.config.schema import Platform
from pipeline.figures.residuals import component_figure
from pipeline.figures.style import COLOURS, PALETTE
from pipeline.io.recording import Recording
from pipeline.trial.ground.accelerometers import fastest_belt, mean_belt_speed, setup_of
from pipeline.trial.ground.calibrations import plate_samples
from pipeline.trial.ground.laboratory import Laboratory, bind, with_corrected_plates
from pipeline.trial.ground.platform import empty_pose, turned_rad
from pipeline.trial.ground.wrenches import plate_artefacts

SWAY: Final = "sway_m"
PITCH: Final = "pitch_deg"
"""Keys of a calibration's provenance: largest sway [m] and pitch [°] of its recording."""
SEGMENT_S: Final = 8.0
"""Of a spectrum: lines 0.125 Hz wide."""
HIGHEST_HZ: Final = 60.0
"""Of spectra: below the modes of load cells."""
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
    motion
        Largest sway and pitch, for the provenance of a calibration; empty where unknown.
    """

    recording: Recording
    rate_hz: float
    before: Mapping[str, Array]
    after: Mapping[str, Array]
    spectra: Mapping[str, Spectrum]
    belts_mps: float | None
    motion: Mapping[str, str]


def measure_empty(
    recording: Recording,
    laboratory: Laboratory,
    platform: Platform | None = None,
) -> EmptyTreadmill:
    """Compensate a recording of the empty treadmill.

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
        What is measured, and what remains.

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
    pose, motion = empty_pose(recording, platform), dict[str, str]()
    if pose is not None:
        is_known = np.isfinite(pose.position).all(axis=1)
        pose = PlatformPose(pose.rotation[is_known], pose.position[is_known])
        sway_m = np.abs(pose.position @ _axis(pose)).max()
        motion = {SWAY: f"{sway_m:.4f}", PITCH: f"{np.degrees(turned_rad(pose).max()):.2f}"}
    return EmptyTreadmill(recording, rate_hz, before, after, spectra, belts_mps, motion)


def _spectrum(before: Array, after: Array, rate_hz: float) -> Spectrum:
    length = min(round(SEGMENT_S * rate_hz), len(before))
    both = np.stack([before, after])
    frequency, power = scipy.signal.welch(both, rate_hz, nperseg=length, axis=1)
    return Spectrum(frequency, *np.sqrt(power))


def _axis(pose: PlatformPose) -> Array:
    """Give the axis of pitch, along which the platform sways, (3,), in any axes of the file."""
    skew = pose.rotation - np.swapaxes(pose.rotation, 1, 2)
    turn = skew[:, [2, 0, 1], [1, 2, 0]]
    vectors = turn if np.abs(turn).max() > 2 * MIN_PITCH_RAD else pose.position
    return np.asarray(np.linalg.eigh(vectors.T @ vectors)[1][:, -1])


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


def spectrum_figure(spectrum: Spectrum, cutoff_hz: float | None) -> Figure:
    """Draw a plate's spectra with the low-passes."""
    frequency = spectrum.frequency_hz
    inside = (frequency > 0.2) & (frequency <= HIGHEST_HZ)
    marks = [("trial filter, 6 Hz", SLOW_HZ, "black", "-")]
    if cutoff_hz is not None:
        marks.append((f"calibration filter, {cutoff_hz:g} Hz", cutoff_hz, "black", ":"))

    def draw(panel: Axes, k: int) -> None:
        panel.axvspan(0.2, SLOW_HZ, color="#f0f2f4", lw=0)
        lines = {"before": spectrum.before, "after": spectrum.after}
        for (label, values), colour in zip(lines.items(), COLOURS.values(), strict=True):
            panel.loglog(frequency[inside], values[inside, k], color=colour, lw=0.9, label=label)
        for label, hz, colour, dashes in marks:
            panel.axvline(hz, color=colour, ls=dashes, lw=0.9, label=label)
        panel.set_xlim(0.2, HIGHEST_HZ)
        panel.yaxis.set_major_formatter("{x:g}")
        panel.set_xticks([0.2, 1, 6, 20, 60], ["0.2", "1", "6", "20", "60"])
        panel.minorticks_off()
        panel.set_xlabel("frequency (Hz)")

    return component_figure(WRENCH_COMPONENTS, draw, "/√Hz")
