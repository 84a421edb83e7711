"""A whole simulated walking study: its files as a laboratory has them, and the truth."""

from collections.abc import Callable
from pathlib import Path
from typing import Final

import pandas as pd
from joblib import delayed

from hbm.coordinates import COORDINATES, N_Q
from hbm.spatial import Array, shift_wrench
from pipeline.config.toml_file import SIMULATED
from pipeline.io.recording import Recording
from pipeline.io.write import whole_file, write_csv, write_text
from pipeline.run.processes import in_processes
from pipeline.virtual_lab.machine.c3d_file import write_c3d
from pipeline.virtual_lab.machine.instrumented_treadmill import (
    PITCH_CHANNEL,
    PLATFORM_MARKERS_M,
    PULSE_CHANNEL,
    SAMPLES_PER_FRAME,
    SENSOR_NAMES,
    SWAY_CHANNEL,
    make_treadmill,
)
from pipeline.virtual_lab.machine.platform import Machine
from pipeline.virtual_lab.person.subject import Person
from pipeline.virtual_lab.person.walk import foot_events, foot_wrenches, leg_moments
from pipeline.virtual_lab.protocol.calibration_trial import beside_names, run_beside
from pipeline.virtual_lab.protocol.walking_protocol import (
    PERSONS,
    ConditionName,
    Protocol,
    Setting,
    read_setting,
    recording_name,
    setting_toml,
)
from pipeline.virtual_lab.protocol.walking_trial import (
    WalkingTrial,
    run_calibration,
    run_trial,
    study_subject,
)

CALIBRATION: Final = "calibration.c3d"
ANOTHER_DAY: Final = "empty_day2.c3d"
"""The empty treadmill with the same signal, which `hbm calibration check` compares."""
CUTOFF_HZ: Final = 6.0
"""Cut-off frequency of the study's filter: the thesis'."""


def study_texts(setting: Setting) -> dict[str, str]:
    """Give the text files of a simulated study.

    Parameters
    ----------
    setting
        Protocol, faults and seed.

    Returns
    -------
    dict
        Name in the study's folder -> content: the setting itself, ``study.toml``, and one file per
        subject.
    """
    protocol = setting.protocol
    return {
        SIMULATED: setting_toml(setting),
        "study.toml": _study_toml(setting),
        **{f"{p.name}.toml": _subject_toml(p, protocol) for p in PERSONS[: protocol.subjects]},
    }


def _platform_toml(setting: Setting) -> str:
    """State how the laboratory knows the platform's pose, with its error."""
    if setting.protocol.pose == "none":
        return ""
    heading = "[treadmill.platform]  # where its pose comes from\n"
    if setting.protocol.pose == "markers":
        names = ", ".join(f'"{name}"' for name in PLATFORM_MARKERS_M)
        return f"{heading}markers = [{names}]"
    x, y, z = Machine().pivot_m
    return f"""\
{heading}sway_channel = "{SWAY_CHANNEL}"
pitch_channel = "{PITCH_CHANNEL}"
pivot_m = [{x:g}, {y:g}, {z + setting.faults.platform.pivot_error_m:g}]"""


def _beside_toml(setting: Setting) -> str:
    """Name the recordings of people beside an empty plate, if there are any."""
    names = "".join(f'  "{name}",\n' for name in beside_names(setting))
    return f"beside = [  # people on it, but not on every plate\n{names}]\n" if names else ""


def _condition_toml(name: ConditionName, protocol: Protocol) -> str:
    """State which gait cycles of a condition count."""
    if name == "sway":
        window = protocol.sway_window
        part = f'"{window}"' if isinstance(window, str) else f"[0.0, {window:g}]"
        return f"""\
[conditions.sway]
perturbed = true  # only the gait cycles with a perturbation
pulse_channel = "{PULSE_CHANNEL}"  # rises at its onset
window = {part}  # of them: the platform's motion, whole cycles, or seconds from the onset
"""
    # gait cycles count from 2 s after the belts have reached their speed (assumed): 50 as in the
    # thesis, or all of a trial that is too short for 50 of 1.5 s
    first_s = protocol.steady_s + 2.0
    is_long = protocol.duration(name) - protocol.steady_s - 2.0 > 50 * 1.5
    cycles = "cycles = 50  # gait cycles that are used, after\n" if is_long else ""
    return f"""\
[conditions.{name}]
{cycles}skip_s = {first_s:g}  # the T-pose and the start of the belts
"""


def _study_toml(setting: Setting) -> str:
    """State the laboratory and its conditions as `pipeline.config.study` reads them."""
    protocol = setting.protocol
    sensors = "\n".join(
        f'{name} = ["{name}.X", "{name}.Y", "{name}.Z"]'
        for name in SENSOR_NAMES[: setting.faults.accelerometers.sensors]
    )
    conditions = "\n".join(_condition_toml(name, protocol) for name in protocol.conditions)
    return f"""\
# A study recorded in the virtual laboratory. Every other TOML file here is a subject;
# {SIMULATED} says what is simulated, with the faults of the laboratory.
name = "virtual laboratory"

[settings]
cutoff_hz = {CUTOFF_HZ:g}  # of the Butterworth filter, on coordinates and forces alike
filter = "{protocol.filter}"
marker_set = "{protocol.marker_set}"

[treadmill]
calibration = "{CALIBRATION}"  # the empty treadmill while it moves
{_beside_toml(setting)}
[treadmill.accelerometers]  # sensor = its x, y and z channels
{sensors}

{_platform_toml(setting)}

{conditions}"""


def _subject_toml(person: Person, protocol: Protocol) -> str:
    """State a person and the person's trials; the plates measure the mass."""
    trials = "\n".join(
        f'[trials.{condition}]\nfile = "{recording_name(person, condition)}"\n'
        for condition in protocol.conditions
    )
    return f"""\
id = "{person.name}"
sex = "{person.sex}"
height_m = {person.height_m:.2f}
age_years = {person.age:g}

{trials}"""


def empty_names(setting: Setting) -> tuple[str, ...]:
    """Name the recordings of empty plates: of the calibration, of another day, with people."""
    names = beside_names(setting)
    return (CALIBRATION, *((ANOTHER_DAY, *names) if names else ()))


def study_files(setting: Setting) -> tuple[str, ...]:
    """Name all files of a simulated study, relative to its folder."""
    protocol = setting.protocol
    return (
        *study_texts(setting),
        *empty_names(setting),
        *(
            name
            for person in PERSONS[: protocol.subjects]
            for condition in protocol.conditions
            for name in trial_names(person, condition)
        ),
    )


def trial_names(person: Person, condition: ConditionName) -> tuple[str, str, str]:
    """Name the files of one trial: the recording, what really happened, and its gait events."""
    recording = recording_name(person, condition)
    truth = Path(SIMULATED).with_name(recording).with_suffix(".parquet")
    return recording, truth.as_posix(), truth.with_name(f"{truth.stem}_events.csv").as_posix()


def missing_files(folder: Path, setting: Setting) -> tuple[str, ...]:
    """Name the files of a simulated study that are not in a folder."""
    return tuple(name for name in study_files(setting) if not (folder / name).is_file())


def folder_setting(folder: Path) -> Setting | None:
    """Give the setting that the study in a folder was simulated with.

    Parameters
    ----------
    folder
        The folder, in which recordings may be missing.

    Returns
    -------
    Setting or None
        None for a folder that is empty or not there.

    Raises
    ------
    ValueError
        If the folder holds other files, or a study that was not simulated.
    """
    if not folder.is_dir() or not any(folder.iterdir()):
        return None
    if not (folder / SIMULATED).is_file():
        if (folder / "study.toml").is_file():
            raise ValueError(
                f"{folder}: its study is not a simulated one (it has no {SIMULATED}), and "
                "simulated recordings would not be of its subjects; name a new folder"
            )
        raise ValueError(f"{folder}: is not empty; name a new folder, nothing is overwritten")
    try:
        return read_setting((folder / SIMULATED).read_text(encoding="utf-8-sig"))
    except ValueError as error:
        raise ValueError(f"{folder / SIMULATED}: {error}") from error


def require_setting(folder: Path, there: Setting, setting: Setting) -> None:
    """Refuse another setting than that of the recordings which may be in a folder already."""
    lines = zip(setting_toml(there).splitlines(), setting_toml(setting).splitlines(), strict=True)
    different = [f"{old} (not {new})" for old, new in lines if old != new]
    if different:
        raise ValueError(
            f"{folder}: its study is simulated with {', '.join(different)}; leave out --setting, "
            "--subjects and --seed, or name a new folder"
        )


WRENCH: Final = ("fx", "fy", "fz", "mx", "my", "mz")
ProgressCallback = Callable[[str, int, int], None]
"""Called with the name of what is done, how many are done, and how many there are."""


def simulate_study(
    out: str | Path,
    setting: Setting | None = None,
    progress: ProgressCallback | None = None,
    jobs: int | None = 2,
    *,
    keep: bool = False,
) -> Path:
    """Simulate a study and write its files as a laboratory would.

    Parameters
    ----------
    out
        Folder to write: ``study.toml``, one TOML and C3D files per subject, ``calibration.c3d`` of
        the empty treadmill; recordings of people beside an empty plate, and with them
        ``empty_day2.c3d``, the empty treadmill on another day; and in ``truth`` the
        setting and per trial what really happened, frame by frame as Parquet and its gait events
        as CSV.
    setting
        Protocol, faults and seed; by default the thesis' protocol and the default faults.
    progress
        Called after every recording with its name, how many are written, and how many will be.
    jobs
        Number of processes; None: all processors. The files do not depend on it.
    keep
        Whether files that are in the folder already are kept; by default they are written anew.

    Returns
    -------
    Path
        The folder, which `pipeline.config.study.read_study` reads.

    Notes
    -----
    Equal settings give files that are equal byte by byte on the same computer. Every file is
    written completely or not at all. Memory is bounded by one trial per process.
    """
    folder, setting = Path(out), setting or Setting()
    protocol = setting.protocol
    to_write = frozenset(missing_files(folder, setting) if keep else study_files(setting))
    for name, text in study_texts(setting).items():
        if name in to_write:
            write_text(text, folder / name)

    tasks = [
        delayed(_write_calibration)(folder, setting, name)
        for name in empty_names(setting)
        if name in to_write
    ]
    tasks += [
        delayed(_write_trial)(folder, setting, number, condition, to_write)
        for number in range(protocol.subjects)
        for condition in sorted(protocol.conditions, key=protocol.duration, reverse=True)
        if not to_write.isdisjoint(trial_names(PERSONS[number], condition))
    ]
    written = folder, (folder / SIMULATED).parent
    for done, name in enumerate(in_processes(tasks, jobs, written), start=1):
        if progress is not None:
            progress(name, done, len(tasks))
    return folder


def write_recording(path: Path, recording: Recording) -> None:
    """Write a recording as C3D, in the axes that are common for this kind of treadmill."""
    write_c3d(
        path,
        recording.markers,
        recording.plates,
        analog=recording.analog,
        events=recording.events,
        metadata=recording.metadata,
    )


def truth_table(trial: WalkingTrial) -> pd.DataFrame:
    """Give what really happened, frame by frame.

    Parameters
    ----------
    trial
        The trial.

    Returns
    -------
    pd.DataFrame
        At the markers' times: ``time``; the 46 coordinates [rad, m], the trunk's those of the
        lumbar joint; ``left_fx`` to ``right_mz``, the wrenches on the feet, lab axes about the lab
        origin; ``artefact_1_fx`` to ``artefact_2_mz``, what the plates' load cells carry of the
        treadmill itself (all that they carry, less the person's load), in the moving platform's
        frame about its origin; ``residual_fx`` to ``residual_mz``, the residual of the equations of
        motion about mid-hip; ``moment_RHipFlexion`` and so on, the internal moments of the legs'
        coordinates [N·m]; ``sway`` [m] and ``pitch`` [rad] of the platform.
    """
    motion, walk = trial.motion, trial.walk
    time = motion.time[::SAMPLES_PER_FRAME]
    q = walk.motion.at(time)[:, :N_Q]
    feet = foot_wrenches(walk, time)
    columns: dict[str, Array] = {"time": time} | dict(zip(COORDINATES, q.T, strict=True))
    for side, wrench in feet.items():
        columns |= _named(side, wrench)
    for number, wrench in enumerate(trial.response.artefacts, start=1):
        columns |= _named(f"artefact_{number}", wrench[::SAMPLES_PER_FRAME])
    residual = shift_wrench(walk.ground.at(time) - feet["left"] - feet["right"], q[:, :3])
    columns |= _named("residual", residual)
    moments = leg_moments(walk, time)
    columns |= {f"moment_{name}": moment for name, moment in moments.items()}
    columns["sway"], columns["pitch"] = (
        x[0][::SAMPLES_PER_FRAME] for x in (motion.platform.sway, motion.platform.pitch)
    )
    return pd.DataFrame(columns)


def event_table(trial: WalkingTrial) -> pd.DataFrame:
    """Give a trial's true gait events.

    Parameters
    ----------
    trial
        The trial.

    Returns
    -------
    pd.DataFrame
        ``time_s``, ``event`` ("foot_strike", "foot_off") and ``side``: where the vertical force on
        a foot passes 20 N.
    """
    events = foot_events(trial.walk, float(trial.motion.time[-1]))
    rows = [(event.time, event.label, event.side) for event in events]
    return pd.DataFrame(rows, columns=["time_s", "event", "side"])


def _named(prefix: str, wrench: Array) -> dict[str, Array]:
    return {f"{prefix}_{name}": wrench[:, k] for k, name in enumerate(WRENCH)}


def _write_calibration(folder: Path, setting: Setting, name: str) -> str:
    """Record the empty treadmill, or people beside a plate that stays empty."""
    treadmill = make_treadmill(setting.faults, setting.seed)
    if name in (CALIBRATION, ANOTHER_DAY):
        recording = run_calibration(setting, treadmill, another_day=name == ANOTHER_DAY)
    else:
        recording = run_beside(setting, treadmill, name)
    write_recording(folder / name, recording)
    return name


def _write_trial(
    folder: Path, setting: Setting, number: int, condition: ConditionName, to_write: frozenset[str]
) -> str:
    """Simulate one trial; write those of its files that are to be written."""
    treadmill = make_treadmill(setting.faults, setting.seed)
    trial = run_trial(setting, treadmill, study_subject(setting, number), number, condition)
    recording, truth, events = trial_names(PERSONS[number], condition)
    if recording in to_write:
        write_recording(folder / recording, trial.recording)
    if truth in to_write:
        with whole_file(folder / truth) as temporary:
            truth_table(trial).to_parquet(temporary, index=False)
    if events in to_write:
        write_csv(event_table(trial), folder / events)
    return recording
