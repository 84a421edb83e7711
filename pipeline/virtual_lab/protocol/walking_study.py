"""A whole simulated walking study: its files as a laboratory has them, and the truth."""

from collections.abc import Callable
from pathlib import Path
from typing import Final

import pandas as pd
from joblib import delayed

from hbm.coordinates import COORDINATES, N_Q
from hbm.spatial import Array, shift_wrench
from pipeline.config.toml_file import SIMULATED
from pipeline.io.c3d.write import write_c3d
from pipeline.io.recording import Recording
from pipeline.io.write import remove_leftovers, whole_file, write_csv, write_text
from pipeline.run.processes import in_processes
from pipeline.virtual_lab.machine.instruments.sampling import SAMPLES_PER_FRAME
from pipeline.virtual_lab.person.ground_reaction import foot_events, foot_wrenches
from pipeline.virtual_lab.protocol.instrumented_treadmill import make_treadmill
from pipeline.virtual_lab.protocol.people_beside import beside_names, run_beside
from pipeline.virtual_lab.protocol.study_folder import missing_files, study_files, trial_names
from pipeline.virtual_lab.protocol.study_text import CALIBRATION, study_texts
from pipeline.virtual_lab.protocol.walking_protocol import PERSONS, ConditionName, Setting
from pipeline.virtual_lab.protocol.walking_trial import (
    WalkingTrial,
    run_calibration,
    run_trial,
    study_subject,
)

WRENCH: Final = ("fx", "fy", "fz", "mx", "my", "mz")
ProgressCallback = Callable[[str, int, int], None]
"""Called with the name of what is done, how many are done, and how many there are."""


def simulate_study(
    out: str | Path,
    setting: Setting | None = None,
    progress: ProgressCallback | None = None,
    jobs: int = 2,
    *,
    keep: bool = False,
) -> Path:
    """Simulate a study and write its files as a laboratory would.

    Parameters
    ----------
    out
        Folder to write: ``study.toml``, one TOML and C3D files per subject, ``calibration.c3d`` of
        the empty treadmill, recordings of people beside an empty plate, and in ``truth`` the
        setting and per trial what really happened, frame by frame as Parquet and its gait events
        as CSV.
    setting
        Protocol, faults and seed; by default the thesis' protocol and the default faults.
    progress
        Called after every recording with its name, how many are written, and how many will be.
    jobs
        Number of processes. The files do not depend on it.
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
    wanted = frozenset(missing_files(folder, setting) if keep else study_files(setting))
    for name, text in study_texts(setting).items():
        if name in wanted:
            write_text(text, folder / name)
    remove_leftovers(folder)
    remove_leftovers((folder / SIMULATED).parent)

    tasks = [
        delayed(_write_calibration)(folder, setting, name)
        for name in (CALIBRATION, *beside_names(setting))
        if name in wanted
    ]
    tasks += [
        delayed(_write_trial)(folder, setting, number, condition, wanted)
        for number in range(protocol.subjects)
        for condition in sorted(protocol.conditions, key=protocol.duration, reverse=True)
        if not wanted.isdisjoint(trial_names(PERSONS[number], condition))
    ]
    for done, name in enumerate(in_processes(tasks, jobs), start=1):
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
        motion about mid-hip; ``sway`` [m] and ``pitch`` [rad] of the platform.
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
    if name == CALIBRATION:
        recording = run_calibration(setting, treadmill)
    else:
        recording = run_beside(setting, treadmill, name)
    write_recording(folder / name, recording)
    return name


def _write_trial(
    folder: Path, setting: Setting, number: int, condition: ConditionName, wanted: frozenset[str]
) -> str:
    """Simulate one trial; write those of its files that are wanted."""
    treadmill = make_treadmill(setting.faults, setting.seed)
    trial = run_trial(setting, treadmill, study_subject(setting, number), number, condition)
    recording, truth, events = trial_names(PERSONS[number], condition)
    if recording in wanted:
        write_recording(folder / recording, trial.recording)
    if truth in wanted:
        with whole_file(folder / truth) as temporary:
            truth_table(trial).to_parquet(temporary, index=False)
    if events in wanted:
        write_csv(event_table(trial), folder / events)
    return recording
