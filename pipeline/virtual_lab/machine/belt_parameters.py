"""Parameters of a belt's drive: identified on recordings, or assumed; each with its interval."""

import tomllib
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final, NamedTuple

import numpy as np

from hbm.spatial import Array

PARAMETERS_TOML: Final = Path(__file__).with_name("belt_parameters.toml")
Row = dict[str, Any]


class RotatingLine(NamedTuple):
    """A pitch moment that turns with the belt's travel and grows with the square of its speed.

    Attributes
    ----------
    turns_per_m
        [1/m].
    moment_kg
        Amplitude [N·m per (m/s)²].
    """

    turns_per_m: float
    moment_kg: float


@dataclass(frozen=True, slots=True)
class BeltDrive:
    """A belt with its drive; masses, forces and speeds at the belt's surface.

    Attributes
    ----------
    moment_kg_m
        Pitch moment per acceleration of everything that turns, far below any mode
        [N·m per m/s²].
    turns_per_m
        Turns of a roller per metre of belt [1/m].
    motor_kg
        Inertia of the motor.
    motor_turns
        Turns of the motor per turn of the roller, in the same sense.
    idler_share
        Share of belt and not driven roller in the inertia of rollers and belt.
    belt_hz, belt_damping
        Mode of the other roller on the elastic belt, with the driving roller held.
    stretch_n
        Force that would stretch the belt to twice its length [N].
    servo_hz, servo_damping
        Of the speed controller with everything stiff.
    torque_lag_s
        Time constant of the motor's current loop [s].
    max_force_n
        Largest force of the motor at the belt [N].
    coulomb_n, static_n, stribeck_mps, viscous_n_per_mps
        Friction of motor and bearings: Coulomb, at breakaway, the speed that separates them,
        viscous.
    board_friction
        Coefficient between belt and board, under a person's weight.
    smooth_mps
        Speed below which friction is proportional to it [m/s].
    unbalance_kg_per_m
        Force of either roller by the square of the belt speed [N per (m/s)²].
    roller_place_m, roller_height_m
        Distance of the rollers before and behind the platform's origin, and their height [m].
    rumble_nm_per_sqrt_hz
        Density of the broad-band pitch moment of a running belt [N·m/√Hz].
    report_hz, report_lag_s, report_delay_s, report_jitter_s
        How often the drive reports the speed of its roller, the time constant of its low-pass, and
        how much later than the load cells, on average and from one report to the next (SD).
    lines
        Other turning parts that are out of balance.

    Notes
    -----
    "Identified" parameters are those of an unloaded treadmill that Hnat and van den Bogert (2014)
    recorded, with 95 % intervals; see ``tests/virtual_machine/identify_belt.py``. All others are
    assumed, in plausible ranges. The belt creeps; it does not slip altogether.
    """

    moment_kg_m: float
    turns_per_m: float
    motor_kg: float
    motor_turns: float
    idler_share: float
    belt_hz: float
    belt_damping: float
    stretch_n: float
    servo_hz: float
    servo_damping: float
    torque_lag_s: float
    max_force_n: float
    coulomb_n: float
    static_n: float
    stribeck_mps: float
    viscous_n_per_mps: float
    board_friction: float
    smooth_mps: float
    unbalance_kg_per_m: float
    roller_place_m: float
    roller_height_m: float
    rumble_nm_per_sqrt_hz: float
    report_hz: float
    report_lag_s: float
    report_delay_s: float
    report_jitter_s: float
    lines: tuple[RotatingLine, ...] = ()

    def __post_init__(self) -> None:
        if not self.turning_kg > 0:
            raise ValueError(
                f"belt drive: {self.moment_kg_m:g} N·m per m/s² leave rollers and belt "
                f"{self.turning_kg:.3g} kg beside a motor of {self.motor_kg:g} kg; expected more "
                "than 0: give a larger moment_kg_m or a smaller motor_kg"
            )

    @property
    def roller_radius_m(self) -> float:
        """Radius of the rollers [m]."""
        return 1 / (2 * np.pi * self.turns_per_m)

    @property
    def turning_kg(self) -> float:
        """Inertia of rollers and belt."""
        return self.moment_kg_m / self.roller_radius_m - self.motor_kg / self.motor_turns

    @property
    def idler_kg(self) -> float:
        """Inertia of belt and other roller."""
        return self.idler_share * self.turning_kg

    @property
    def roller_kg(self) -> float:
        """Inertia of the driving roller."""
        return self.turning_kg - self.idler_kg

    @property
    def driving_kg(self) -> float:
        """Inertia of motor and driving roller."""
        return self.motor_kg + self.turning_kg - self.idler_kg

    @property
    def belt_stiffness(self) -> tuple[float, float]:
        """Stiffness and damping of the belt between its rollers [N/m, N·s/m]."""
        omega = 2 * np.pi * self.belt_hz
        return self.idler_kg * omega**2, 2 * self.belt_damping * self.idler_kg * omega

    @property
    def gains(self) -> tuple[float, float]:
        """Proportional and integral gain of the speed controller [N·s/m, N/m]."""
        omega = 2 * np.pi * self.servo_hz
        mass = self.motor_kg + self.turning_kg
        return 2 * self.servo_damping * omega * mass, omega**2 * mass

    def bearing_friction(self, speed: Array) -> Array:
        """Give the friction of motor and bearings at a speed, (N,) [N]."""
        breakaway = (self.static_n - self.coulomb_n) * np.exp(-((speed / self.stribeck_mps) ** 2))
        sliding = (self.coulomb_n + breakaway) * np.tanh(speed / self.smooth_mps)
        return np.asarray(sliding + self.viscous_n_per_mps * speed)

    def board_force(self, speed: Array, weight: Array) -> Array:
        """Give the friction of the belt on its board under a weight, (N,) [N]."""
        return self.board_friction * np.maximum(weight, 0) * np.tanh(speed / self.smooth_mps)

    def creep(self, speed: Array, force: Array) -> Array:
        """Give how much slower the belt is than its driving roller when it pulls, (N,) [m/s]."""
        return np.abs(speed) * force / self.stretch_n


def identified_drive() -> BeltDrive:
    """Give the drive with its stored parameters.

    Examples
    --------
    >>> f"roller of {200 * identified_drive().roller_radius_m:.0f} cm diameter"
    'roller of 20 cm diameter'
    """
    return _drive(lambda row: row["value"])


def scattered_drive(rng: np.random.Generator) -> BeltDrive:
    """Draw a drive whose parameters lie anywhere within their intervals.

    Parameters
    ----------
    rng
        Source of the draws.

    Returns
    -------
    BeltDrive
        Equal generators give equal drives.
    """
    return _drive(lambda row: rng.uniform(row["low"], row["high"]))


def _drive(choose: Callable[[Row], float]) -> BeltDrive:
    table = tomllib.loads(PARAMETERS_TOML.read_text(encoding="utf-8"))
    lines = [RotatingLine(x["turns_per_m"], choose(x["moment_kg"])) for x in table.pop("lines")]
    return BeltDrive(**{name: choose(row) for name, row in table.items()}, lines=tuple(lines))
