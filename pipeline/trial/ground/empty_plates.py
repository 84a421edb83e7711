"""Recordings of empty plates: how they are read, and their samples for the fit of a calibration."""

from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Final

import numpy as np
from numpy.typing import ArrayLike

from compensation import InertiaModel, Sensor, Setup
from compensation.inertia.quality import MIN_LOAD_N
from hbm.signals.filtering import Method
from hbm.signals.resampling import resample
from hbm.spatial import Array
from pipeline.config.plate_correction import PlateCorrection
from pipeline.config.schema import Treadmill
from pipeline.io.read import read_as_stated
from pipeline.io.recording import Recording
from pipeline.io.stated import Stated
from pipeline.trial.ground.accelerometers import accelerations, at_times_of_plates
from pipeline.trial.ground.corrected_plates import relative_delays_s, with_corrected_plates

FILTER: Final[Method] = "zero_phase"
"""A delay of what is subtracted would leave an artefact wherever platform or belt accelerate."""
BESIDE: Final = "beside"
"""Key of a calibration's provenance that names the recordings of people beside empty plates."""
LOAD_S: Final = 2.0
"""Over which the vertical force of a plate is averaged to see whether somebody is on it: longer
than a stride, so that steps count as well as standing."""

STEP_S: Final = 0.2
MAX_STEP_N: Final = 50.0
"""A step on a plate is longer and heavier; vibration and drift of an empty one are less."""
MIN_BESIDE_S: Final = 10.0
"""Some strides: less says little of how people shake the platform."""
AXES_BY_VERTICAL: Final = ("forward,left,up", "forward,up,right", "up,forward,left")
"""One choice with each of the file's axes as the vertical one."""
MIN_COSINE_LEVEL: Final = 0.7
"""Of the angle between a level plate's normal and the vertical, about 45°."""


def read_empty(path: Path, stated: Stated, *, any_forward: bool = True) -> Recording:
    """Read a recording of the empty treadmill.

    Parameters
    ----------
    path
        The file, of any format that is read.
    stated
        How it is to be read; marker set and label prefix are those of a subject and do not count.
        Without axes, any directions are taken in which the plates lie level: nothing shows which
        way is forward, and a calibration in the plates' own axes does not need it.
    any_forward
        Whether that is so; a correction of its plates is in the lab's axes and does need it.

    Returns
    -------
    Recording
        The trial.

    Raises
    ------
    ValueError, OSError
        If the file cannot be read, or what is to be calibrated is subtracted from its plates.
    """
    read = _read_with_any_axes if any_forward else read_as_stated
    recording = read(path, replace(stated, marker_set=None, label_prefix=None))
    if recording.compensation is not None:
        raise ValueError(
            f"{path.name}: its plates are compensated, by {recording.compensation.software}; a "
            "calibration needs the original recording"
        )
    return recording


def _read_with_any_axes(path: Path, stated: Stated) -> Recording:
    try:
        return read_as_stated(path, stated)
    except ValueError as first:
        for axes in AXES_BY_VERTICAL if stated.axes is None else ():
            try:
                recording = read_as_stated(path, replace(stated, axes=axes))
            except ValueError:
                continue
            if all(abs(plate.rotation[2, 2]) > MIN_COSINE_LEVEL for plate in recording.plates):
                return recording
        raise first


def plate_samples(
    recording: Recording,
    treadmill: Treadmill,
    sensors: Sequence[Sensor],
    correction: PlateCorrection | None,
    lags_s: Sequence[float] = (),
) -> dict[str, tuple[Array, Array]]:
    """Give what was felt and the wrench of every plate, where both are known.

    Parameters
    ----------
    recording
        Its plates corrected already.
    treadmill
        Names of its accelerometers' channels and the cut-off.
    sensors
        Of which delays are undone.
    correction
        Of the plates, which may state their delays.
    lags_s
        Of the differences that a dynamic model needs; these follow the readings [s].

    Returns
    -------
    dict
        "plate 1", "plate 2", … -> felt (N, K) [m/s²], wrench (N, 6) [N, N·m].

    Raises
    ------
    ValueError
        A channel is missing, or its unit is unknown.
    """
    clock, readings = accelerations(recording, treadmill)
    setup = setup_of(recording, treadmill)
    filtered = setup.low_pass(readings, clock)
    found, times = {}, [plate.time for plate in recording.plates]
    for plate, felt, wrench in zip(
        recording.plates,
        at_times_of_plates(clock, filtered, times, treadmill, sensors, lags_s),
        wrenches_in_time(recording, setup, correction),
        strict=True,
    ):
        known = np.isfinite(felt).all(axis=1) & np.isfinite(wrench).all(axis=1)
        if not known.any():
            raise ValueError(
                f"{recording.source.name}: plate {plate.number} has no samples at which the "
                "accelerometers are known"
            )
        found[f"plate {plate.number}"] = samples_of(felt, known), samples_of(wrench, known)
    return found


def empty_plates(
    recording: Recording,
    treadmill: Treadmill,
    sensors: Sequence[Sensor],
    correction: PlateCorrection | None,
    models: Mapping[str, InertiaModel],
    lags_s: Sequence[float] = (),
) -> dict[str, tuple[Array, Array]]:
    """Give the samples of those plates of a recording that nobody was on.

    Parameters are those of `plate_samples`, the recording as it was read, and the static models of
    a calibration by which a load is seen.

    Raises
    ------
    ValueError
        As `plate_samples`; recorded otherwise than the calibration, somebody was on a plate for a
        while, or on every plate.
    """
    source = recording.source.name
    if not recording.plates:
        raise ValueError(
            f"{source}: a recording beside an empty plate needs plates: {recording.why_no_plates}"
        )
    setup = setup_of(recording, treadmill)
    recording = with_corrected_plates(recording, correction)
    samples, empty = plate_samples(recording, treadmill, sensors, correction, lags_s), {}
    for name, (felt, wrench) in samples.items():
        if name not in models:
            continue
        model = models[name]
        try:
            model.require(setup)
        except ValueError as error:
            raise ValueError(f"{source}: {error}") from error
        force = model.compensate(felt[:, : len(model.acceleration_mean)], wrench)[:, 2]
        if len(force) < MIN_BESIDE_S * setup.rate_hz:
            raise ValueError(
                f"{source}: {len(force) / setup.rate_hz:.1f} s are too short, expected "
                f"{MIN_BESIDE_S:g} s or more; record a minute"
            )
        carried = np.abs(_means(force, setup, LOAD_S)) > MIN_LOAD_N
        if not carried.any():
            steps = _means(force, setup, STEP_S)
            highest = float(np.abs(steps - np.median(steps)).max())
            if highest > MAX_STEP_N:
                raise ValueError(
                    f"{source}: somebody stepped on {name} ({highest:.0f} N over {STEP_S:g} s, "
                    f"expected {MAX_STEP_N:g} N at most of an empty plate); record people who stay "
                    "on the other plate or on the boards"
                )
            empty[name] = felt, wrench
        elif not carried.all():
            raise ValueError(
                f"{source}: somebody was on {name} in {100 * carried.mean():.0f} % of the "
                f"recording (more than {MIN_LOAD_N:g} N on average over {LOAD_S:g} s); record "
                "people who stay on the other plate or on the boards all the time"
            )
    if not empty:
        raise ValueError(
            f"{source}: somebody was on every plate; a recording beside the empty plate leaves one "
            "plate empty"
        )
    return empty


def _means(force: Array, setup: Setup, length_s: float) -> Array:
    """Give the means of parts of about a length, (parts,)."""
    parts = max(len(force) // round(length_s * setup.rate_hz), 1)
    return np.array([part.mean() for part in np.array_split(force, parts)])


def samples_of(channels: Array, known: ArrayLike) -> Array:
    """Give the known ones, (M, K), of some samples, (N, K), every channel in one piece of memory.

    Fits sum over samples again and again, which then takes a tenth of the time.
    """
    return channels.T.compress(np.asarray(known), axis=1).T


def setup_of(recording: Recording, treadmill: Treadmill) -> Setup:
    """Give how a recording's plates and accelerometers were recorded and are to be filtered."""
    rate = float(1 / np.median(np.diff(recording.plates[0].time)))
    return Setup(
        tuple(treadmill.accelerometers), round(rate, 6), treadmill.cutoff_hz, filter_method=FILTER
    )


def wrenches_in_time(
    recording: Recording, setup: Setup, correction: PlateCorrection | None
) -> list[Array]:
    """Give the low-passed plates (N, 6), each read ahead by how much later it is than the first."""
    late = relative_delays_s(recording.plates, correction)
    wrenches = [setup.low_pass(plate.wrench_in_plate, plate.time) for plate in recording.plates]
    return [
        wrench if late_s == 0 else resample(plate.time, wrench, plate.time + late_s)
        for plate, wrench, late_s in zip(recording.plates, wrenches, late, strict=True)
    ]
