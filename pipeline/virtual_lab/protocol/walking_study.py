"""A whole simulated walking study: its files as a laboratory has them, and the truth."""

from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Final

import pandas as pd
from joblib import Parallel, delayed

from hbm.coordinates import COORDINATES
from hbm.kernels.native import kernels
from hbm.spatial import Array, shift_wrench
from pipeline.io.c3d.write import write_c3d
from pipeline.io.recording import Recording
from pipeline.virtual_lab.machine.artefacts import treadmill_wrenches
from pipeline.virtual_lab.machine.instruments.accelerometer import SENSOR_NAMES
from pipeline.virtual_lab.machine.instruments.sampling import SAMPLES_PER_FRAME
from pipeline.virtual_lab.machine.treadmill import Machine
from pipeline.virtual_lab.person.ground_reaction import foot_wrenches
from pipeline.virtual_lab.person.subject import Person
from pipeline.virtual_lab.protocol.instrumented_treadmill import (
    PITCH_CHANNEL,
    PLATFORM_MARKERS_M,
    PULSE_CHANNEL,
    SWAY_CHANNEL,
    make_treadmill,
)
from pipeline.virtual_lab.protocol.setting_file import setting_toml
from pipeline.virtual_lab.protocol.walking_protocol import PERSONS, ConditionName, Protocol, Setting
from pipeline.virtual_lab.protocol.walking_trial import (
    WalkingTrial,
    run_calibration,
    run_trial,
    study_subject,
)

WRENCH: Final = ("fx", "fy", "fz", "mx", "my", "mz")
CALIBRATION: Final = "calibration.c3d"
TRUTH: Final = "truth"
CYCLES: Final = 50
CUTOFF_HZ: Final = 6.0
"""Gait cycles per condition, and cut-off frequency: the thesis'."""
SETTLE_S: Final = 2.0
"""After the belts have reached their speed, before the gait cycles are counted; assumed."""
ProgressCallback = Callable[[str, int, int], None]
"""Called with the name of what is done, how many are done, and how many there are."""


def simulate_study(
    out: str | Path,
    setting: Setting | None = None,
    progress: ProgressCallback | None = None,
    jobs: int = 2,
) -> Path:
    """Simulate a study and write its files as a laboratory would.

    Parameters
    ----------
    out
        Folder to write: ``study.toml``, one TOML and C3D files per subject, ``calibration.c3d`` of
        the empty treadmill, and in ``truth`` the setting and one Parquet file per trial.
    setting
        Protocol, faults and seed; by default the thesis' protocol and the default faults.
    progress
        Called after every file with its name, the number of files written, and of all files.
    jobs
        Number of processes. The files do not depend on it.

    Returns
    -------
    Path
        The folder, which `pipeline.config.study.read_study` reads.

    Notes
    -----
    Equal settings give files that are equal byte by byte on the same computer. Memory is bounded by
    one trial per process.
    """
    folder, setting = Path(out), setting or Setting()
    (folder / TRUTH).mkdir(parents=True, exist_ok=True)
    protocol = setting.protocol
    (folder / "study.toml").write_text(_study_toml(setting), encoding="utf-8")
    (folder / TRUTH / "setting.toml").write_text(setting_toml(setting), encoding="utf-8")
    for person in PERSONS[: protocol.subjects]:
        text = _subject_toml(person, protocol)
        (folder / f"{person.name}.toml").write_text(text, encoding="utf-8")

    kernels()  # compiled once before the processes start
    tasks = [delayed(_write_calibration)(folder, setting)]
    tasks += [
        delayed(_write_trial)(folder, setting, number, condition)
        for number in range(protocol.subjects)
        for condition in sorted(protocol.conditions, key=protocol.duration, reverse=True)
    ]
    finished: Iterator[str] = Parallel(n_jobs=jobs, return_as="generator_unordered")(tasks)
    for done, name in enumerate(finished, start=1):
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


def truth_table(trial: WalkingTrial, machine: Machine) -> pd.DataFrame:
    """Give what really happened, frame by frame.

    Parameters
    ----------
    trial
        The trial.
    machine
        The treadmill it was on.

    Returns
    -------
    pd.DataFrame
        At the markers' times: ``time``; the 46 coordinates [rad, m]; ``left_fx`` to ``right_mz``,
        the wrenches on the feet, lab axes about the lab origin; ``artefact_1_fx`` to
        ``artefact_2_mz``, what the plates' load cells carry of the treadmill itself, in the moving
        platform's frame about its origin; ``residual_fx`` to ``residual_mz``, the residual of the
        equations of motion about mid-hip; ``sway`` [m] and ``pitch`` [rad] of the platform.
    """
    motion, walk = trial.motion, trial.walk
    time = motion.time[::SAMPLES_PER_FRAME]
    q = walk.motion.at(time)
    feet = foot_wrenches(walk, time)
    columns: dict[str, Array] = {"time": time} | dict(zip(COORDINATES, q.T, strict=True))
    for side, wrench in feet.items():
        columns |= _named(side, wrench)
    for number, wrench in enumerate(treadmill_wrenches(machine, motion), start=1):
        columns |= _named(f"artefact_{number}", wrench[::SAMPLES_PER_FRAME])
    state = [walk.motion.at(time, k) for k in range(3)]
    body = walk.subject.body
    required = kernels().newton_euler(*state, body.geometry, body.inertia_vector)[1]
    residual = shift_wrench(required - feet["left"] - feet["right"], q[:, :3])
    columns |= _named("residual", residual)
    columns["sway"], columns["pitch"] = (
        x[0][::SAMPLES_PER_FRAME] for x in (motion.platform.sway, motion.platform.pitch)
    )
    return pd.DataFrame(columns)


def _named(prefix: str, wrench: Array) -> dict[str, Array]:
    return {f"{prefix}_{name}": wrench[:, k] for k, name in enumerate(WRENCH)}


def _write_calibration(folder: Path, setting: Setting) -> str:
    treadmill = make_treadmill(setting.faults, setting.seed)
    write_recording(folder / CALIBRATION, run_calibration(setting, treadmill))
    return CALIBRATION


def _write_trial(folder: Path, setting: Setting, number: int, condition: ConditionName) -> str:
    treadmill = make_treadmill(setting.faults, setting.seed)
    trial = run_trial(setting, treadmill, study_subject(setting, number), number, condition)
    name = trial.recording.source.name
    write_recording(folder / name, trial.recording)
    table = truth_table(trial, treadmill.machine)
    table.to_parquet(folder / TRUTH / Path(name).with_suffix(".parquet"), index=False)
    return name


def _platform_toml(setting: Setting) -> str:
    """State how the laboratory knows the platform's pose, with its error."""
    if setting.protocol.pose == "markers":
        names = ", ".join(f'"{name}"' for name in PLATFORM_MARKERS_M)
        return f"markers = [{names}]"
    x, y, z = Machine().pivot_m
    return f"""\
sway_channel = "{SWAY_CHANNEL}"
pitch_channel = "{PITCH_CHANNEL}"
pivot_m = [{x:g}, {y:g}, {z + setting.faults.platform.pivot_error_m:g}]"""


def _study_toml(setting: Setting) -> str:
    """State the laboratory and its conditions as `pipeline.config.study` reads them."""
    protocol = setting.protocol
    sensors = "\n".join(
        f'{name} = ["{name}.X", "{name}.Y", "{name}.Z"]'
        for name in SENSOR_NAMES[: setting.faults.accelerometers.sensors]
    )
    skip = protocol.steady_s + SETTLE_S
    keys = {
        "familiarisation": f"cycles = {CYCLES}\nskip_s = {skip:g}",
        "baseline": f"cycles = {CYCLES}\nskip_s = {skip:g}",
        "sway": f'perturbed = true\npulse_channel = "{PULSE_CHANNEL}"',
        "pitch": f"cycles = {CYCLES}\nskip_s = {skip:g}",
    }
    conditions = "\n\n".join(f"[conditions.{name}]\n{keys[name]}" for name in protocol.conditions)
    return f"""\
# A study recorded in the virtual laboratory. truth/setting.toml lists its faults.
name = "virtual laboratory"

[settings]
cutoff_hz = {CUTOFF_HZ:g}
filter = "zero_phase"
marker_set = "{protocol.marker_set}"

[treadmill]
calibration = "{CALIBRATION}"

[treadmill.accelerometers]
{sensors}

[treadmill.platform]
{_platform_toml(setting)}

{conditions}
"""


def _subject_toml(person: Person, protocol: Protocol) -> str:
    trials = "\n".join(
        f'[trials.{condition}]\nfile = "{person.name}_{condition}.c3d"\n'
        for condition in protocol.conditions
    )
    return f"""\
id = "{person.name}"
sex = "{person.sex}"
height_m = {person.height_m:.2f}
age_years = {person.age:g}

{trials}"""
