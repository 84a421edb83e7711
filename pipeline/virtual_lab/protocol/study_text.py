"""The text files of a simulated study: what a laboratory would type about it, and its setting."""

from typing import Final

from pipeline.config.toml_file import SIMULATED
from pipeline.virtual_lab.machine.instruments.accelerometer import SENSOR_NAMES
from pipeline.virtual_lab.machine.readings import (
    PITCH_CHANNEL,
    PLATFORM_MARKERS_M,
    PULSE_CHANNEL,
    SWAY_CHANNEL,
)
from pipeline.virtual_lab.machine.treadmill import Machine
from pipeline.virtual_lab.person.subject import Person
from pipeline.virtual_lab.protocol.people_beside import beside_names
from pipeline.virtual_lab.protocol.setting_file import setting_toml
from pipeline.virtual_lab.protocol.walking_protocol import (
    PERSONS,
    ConditionName,
    Protocol,
    Setting,
    recording_name,
)

CALIBRATION: Final = "calibration.c3d"
CYCLES: Final = 50
CUTOFF_HZ: Final = 6.0
"""Gait cycles per condition, and cut-off frequency: the thesis'."""
SETTLE_S: Final = 2.0
"""After the belts have reached their speed, before the gait cycles are counted; assumed."""


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
    heading = "[treadmill.platform]  # how its pose is known\n"
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
    return f"""\
[conditions.{name}]
cycles = {CYCLES}  # gait cycles that count, after
skip_s = {protocol.steady_s + SETTLE_S:g}  # the T-pose and the start of the belts
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
# A study recorded in the virtual laboratory. Every other TOML file beside this one is a subject;
# {SIMULATED} states what is simulated, with the faults of the laboratory.
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
