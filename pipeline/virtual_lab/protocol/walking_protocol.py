"""The protocol of the walking study, the thesis' third experiment: subjects and perturbations.

Source: van de Loosdrecht (2018), II.C and D.5.
"""

from importlib.resources import files
from itertools import product
from pathlib import Path
from typing import Annotated, Any, Final, Literal

import numpy as np
from pydantic import AfterValidator, BaseModel, Field, ValidationError, model_validator

from compensation.protocol import ADVISED_PLATFORM_SIGNAL, DURATIONS_S, PLATFORM_KINDS
from hbm.numbers import read_numbers
from hbm.signals.filtering import Method
from hbm.spatial import Array
from hbm.spelling import did_you_mean, listed, parse_toml, shown
from pipeline.config.input_model import InputModel
from pipeline.config.toml_file import describe_faults
from pipeline.io.input_file import read_text
from pipeline.virtual_lab.faults import Faults
from pipeline.virtual_lab.machine.platform import smooth_step
from pipeline.virtual_lab.person.gait import Steps
from pipeline.virtual_lab.person.subject import Person

MOTION: Final = read_numbers("pipeline.virtual_lab.protocol", "parameters.toml", "motion")

ConditionName = Literal["baseline", "sway", "pitch"]
CONDITIONS: Final[tuple[ConditionName, ...]] = ("baseline", "sway", "pitch")
"""The thesis'; what is random in a trial depends on the place of its condition here."""

PERSONS: Final = (
    Person("sub01", "male", 83.0, 1.85, 22),
    Person("sub02", "female", 58.9, 1.64, 27),
    Person("sub03", "male", 74.7, 1.77, 26),
    Person("sub04", "male", 89.9, 1.97, 26),
    Person("sub05", "female", 64.6, 1.66, 22),
    Person("sub06", "male", 75.5, 1.80, 34),
    Person("sub07", "male", 82.3, 1.81, 25),
    Person("sub08", "female", 58.7, 1.59, 23),
    Person("sub09", "male", 83.8, 1.93, 29),
)
"""Six men and three women with the mean and standard deviation of age (26 ± 3.8 years), stature
(1.78 ± 0.13 m) and mass (74.6 ± 11.45 kg) of the thesis' subjects; individual values are invented.
"""
Seconds = Annotated[float, Field(gt=0)]
Window = Annotated[float, Field(gt=0, le=1.0)]
"""Seconds from the onset of a perturbation, at most about a gait cycle."""
Wait = Annotated[float, Field(ge=12.0)]
"""The platform has to be back in neutral before it sways again, 10 s after an onset."""
Speed = Annotated[float, Field(ge=0.5, le=1.8)]
"""To which the gait pattern of 1.3 m/s may be scaled [m/s]; assumed."""
SIGNALS: Final = [
    f"{kind}_{duration_s}s_{speed_mps}mps"
    for kind, duration_s, speed_mps in product(PLATFORM_KINDS, DURATIONS_S, (0, 3))
]


def _known_signal(name: str) -> str:
    """Refuse what is no signal of `compensation.protocol`."""
    if name not in SIGNALS:
        raise ValueError(
            f"got {shown(name)}{did_you_mean(name, SIGNALS)}; signals: {listed(SIGNALS, 99)}"
        )
    return name


CalibrationSignal = Annotated[str, AfterValidator(_known_signal)]


class Protocol(InputModel):
    """What every subject does; the defaults are the thesis', with people beside an empty plate.

    The belts start after ``standing_s`` of T-pose and lowering the arms and reach their speed
    within ``starting_s``; durations of the conditions count from then. ``calibration`` is one of
    the signals of `compensation.protocol`, with the belts at 0 or 3 m/s; ``beside_s`` is
    how long each of the recordings of people beside an empty plate lasts that are fitted with it, 0
    for none. ``pose`` is whether the study takes the platform's pose from its markers or its
    channels, or has none, so that forces stay in the plates' axes; ``filter`` is how it filters,
    and ``sway_window`` what of a perturbed gait cycle counts: "motion", "cycle", or seconds from
    the onset on.
    """

    conditions: Annotated[tuple[ConditionName, ...], Field(strict=False)] = CONDITIONS
    subjects: Annotated[int, Field(ge=1, le=len(PERSONS))] = len(PERSONS)
    speed_mps: Speed = 1.3
    standing_s: Seconds = 4.0
    starting_s: Seconds = 4.0
    baseline_s: Seconds = 120.0
    pitch_s: Seconds = 120.0
    # before the 20 perturbations, from full belt speed on: the thesis'
    waits_s: Annotated[tuple[Wait, ...], Field(strict=False)] = (
        *(17.0, 58.0, 37.0, 17.0, 23.0, 52.0, 22.0, 51.0, 22.0, 57.0),
        *(27.0, 20.0, 22.0, 41.0, 34.0, 27.0, 52.0, 39.0, 38.0, 56.0),
    )
    marker_set: Literal["hbm2", "hbm1"] = "hbm2"
    pose: Literal["markers", "channels", "none"] = "markers"
    filter: Method = "zero_phase"
    sway_window: Literal["motion", "cycle"] | Window = "motion"
    calibration: CalibrationSignal = "square_sway_300s_3mps"
    beside_s: Annotated[float, Field(ge=0)] = 60.0

    @model_validator(mode="after")
    def _is_consistent(self) -> "Protocol":
        if "sway" in self.conditions and self.pose == "none" and self.sway_window == "motion":
            raise ValueError(
                'pose = "none" leaves the motion of the platform unknown; set sway_window = '
                '"cycle" or seconds'
            )
        # 10 s of a recording are needed, and its ends are lost
        if 0 < self.beside_s < 12.0:
            raise ValueError(
                f"beside_s is {self.beside_s:g}; expected 12 or more, or 0 for no "
                "recordings of people beside an empty plate"
            )
        return self

    @property
    def steady_s(self) -> float:
        """When the belts have reached their speed [s]."""
        return self.standing_s + self.starting_s

    def duration(self, condition: ConditionName) -> float:
        """Give the duration of a trial [s]."""
        walking: dict[str, float] = {
            "baseline": self.baseline_s,
            "sway": sum(self.waits_s) + MOTION.after,
            "pitch": self.pitch_s,
        }
        return self.steady_s + walking[condition]


DEMO: Final = Protocol(
    baseline_s=30.0,
    pitch_s=33.0,
    waits_s=(12.0, 12.0, 12.0, 12.0),
    calibration=ADVISED_PLATFORM_SIGNAL,
)
"""All subjects, whom the statistics need, in a minute on two cores: two perturbations to each side,
one period of the pitch sine after the start of the belts, and the calibration that is advised."""


class Setting(InputModel):
    """A simulated study: its protocol, its laboratory's faults, and the seed of what is random."""

    seed: int = 1
    protocol: Protocol = Protocol()
    faults: Faults = Faults()


def recording_name(person: Person, condition: ConditionName) -> str:
    """Name the recording of one person in one condition."""
    return f"{person.name}_{condition}.c3d"


def perturbations(protocol: Protocol, steps: Steps, seed: int) -> tuple[Array, Array]:
    """Choose when the platform sways, and to which side.

    Parameters
    ----------
    protocol
        The waits between perturbations.
    steps
        The person's steps: a perturbation starts at 10 % of a gait cycle.
    seed
        Seed of the order of sides, the same for all subjects: half of the perturbations start at
        right initial contacts.

    Returns
    -------
    onsets
        (P,) [s].
    directions
        +1 to the left, after a right initial contact; -1 to the right, (P,).
    """
    count = len(protocol.waits_s)
    directions = np.where(np.arange(count) % 2 == 0, 1.0, -1.0)
    np.random.default_rng((seed, count)).shuffle(directions)
    # the first contact after a wait of the foot opposite to the side to which the platform sways
    planned = protocol.steady_s + np.cumsum(protocol.waits_s)
    right = np.arange(len(steps.contact)) % 2 == 1
    onsets = []
    for time, direction in zip(planned, directions, strict=True):
        contact = steps.contact[right == (direction > 0)]
        k = int(np.searchsorted(contact, time))
        onsets.append(contact[k] + MOTION.onset * (contact[k + 1] - contact[k]))
    return np.array(onsets), directions


def sway_command(onsets: Array, directions: Array, time: Array) -> Array:
    """Give the commanded sway: out at constant speed, back slowly after seven seconds, (N,) [m]."""
    sway = np.zeros(len(time))
    for onset, direction in zip(onsets, directions, strict=True):
        since = time - onset
        out = np.clip(since * MOTION.sway_speed / MOTION.sway, 0, 1)
        sway += (
            direction
            * MOTION.sway
            * (out - smooth_step((since - MOTION.return_after) / MOTION.return_duration))
        )
    return sway


def pitch_command(protocol: Protocol, time: Array) -> Array:
    """Give the commanded pitch: a sine that grows within two seconds, (N,) [rad]."""
    since = time - protocol.steady_s
    sine = np.sin(2 * np.pi * since / MOTION.pitch_period)
    return np.asarray(-np.radians(MOTION.pitch) * smooth_step(since / MOTION.pitch_fade) * sine)


SHIPPED: Final = ("thesis",)
"""Names of the settings beside this module: what a thesis states of its laboratory."""


def find_setting(name: Path) -> Setting:
    """Read a setting from a file, or a shipped one by its name.

    Parameters
    ----------
    name
        A file or, where there is no such file, one of `SHIPPED`.

    Returns
    -------
    Setting
        Checked.

    Raises
    ------
    FileNotFoundError
        If there is neither.
    ValueError
        As `read_setting`.

    Examples
    --------
    >>> find_setting(Path("thesis")).faults.platform.delay_s
    0.03
    """
    if name.exists() or str(name) not in SHIPPED:
        return read_setting(read_text(name))
    return read_setting((files(__package__) / f"{name}.toml").read_text(encoding="utf-8"))


def read_setting(text: str) -> Setting:
    """Read a setting from TOML; what is not stated keeps its default.

    Parameters
    ----------
    text
        ``seed``, ``[protocol]``, and every fault in its table: ``[faults.machine]``,
        ``[faults.clocks]``, ``[faults.body]``, ``[faults.cameras]``, ``[faults.plates]``,
        ``[faults.accelerometers]``, ``[faults.belts]``, ``[faults.platform]``.

    Returns
    -------
    Setting
        Checked.

    Raises
    ------
    ValueError
        If the text is not TOML, or keys or values are wrong; all of them in one line.
    """
    try:
        table = parse_toml(text)
    except ValueError as error:
        raise ValueError(f"setting: not valid TOML: {error}") from error
    try:
        return Setting.model_validate(table)
    except ValidationError as error:
        raise ValueError("setting: " + "; ".join(describe_faults(error, Setting, table))) from error


def setting_toml(setting: Setting) -> str:
    """Write a setting as TOML, with every value."""
    return "\n".join(_lines("", setting))


def _lines(name: str, model: BaseModel) -> list[str]:
    values = {key: getattr(model, key) for key in type(model).model_fields}
    plain = {k: v for k, v in values.items() if not isinstance(v, BaseModel)}
    lines = [f"[{name}]"] if name and plain else []
    lines += [f"{key} = {_toml(value)}" for key, value in plain.items()]
    lines += [""] if plain else []
    for key, value in values.items():
        if isinstance(value, BaseModel):
            lines += _lines(f"{name}.{key}" if name else key, value)
    return lines


def _toml(value: Any) -> str:
    if isinstance(value, bool):
        return str(value).lower()
    if isinstance(value, str):
        return f'"{value}"'
    if isinstance(value, tuple):
        return f"[{', '.join(_toml(item) for item in value)}]"
    return repr(value)
