"""The belts: motor, speed controller, rollers, an elastic belt, and friction.

Everything is expressed at the belt's surface: a rotor is the mass that is as hard to accelerate
there. Motor and driving roller are one mass; an elastic belt, which creeps on its rollers, pulls
the other roller and slides on a board. All of this is carried by the load cells. What happens
between its parts cancels (Willems and Gosseye 2013, Biology Open 2:1421): the cells see how the
angular momentum changes, and what is out of balance. `run_linear_belt` is a belt that answers as
compensation assumes, for tests of arithmetic.
"""

import tomllib
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Final, NamedTuple

import numpy as np
from scipy.signal import butter, cont2discrete, lfilter, sosfilt

from hbm.numbers import read_numbers
from hbm.spatial import Array
from pipeline.virtual_lab.faults import BeltFaults
from pipeline.virtual_lab.machine.platform import Machine, Pair, follow

BELTS: Final = read_numbers("pipeline.virtual_lab.machine", "parameters.toml", "belts")
PLATE: Final = read_numbers("pipeline.virtual_lab.machine", "parameters.toml", "plate")

PARAMETERS_TOML: Final = Path(__file__).with_name("belt_parameters.toml")


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
        Fraction of the inertia of rollers and belt that belt and not driven roller have.
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
    def gains(self) -> tuple[float, float]:
        """Proportional and integral gain of the speed controller [N·s/m, N/m]."""
        omega = 2 * np.pi * self.servo_hz
        mass = self.motor_kg + self.turning_kg
        return 2 * self.servo_damping * omega * mass, omega**2 * mass

    def bearing_friction(self, speed: Array) -> Array:
        """Give the friction of motor and bearings at a speed, (N,) [N]."""
        # Stribeck's curve: friction falls from breakaway to Coulomb's as the bearing begins to turn
        breakaway = (self.static_n - self.coulomb_n) * np.exp(-((speed / self.stribeck_mps) ** 2))
        sliding = (self.coulomb_n + breakaway) * np.tanh(speed / self.smooth_mps)
        return np.asarray(sliding + self.viscous_n_per_mps * speed)


def identified_drive(rng: np.random.Generator | None = None) -> BeltDrive:
    """Give the drive with its stored parameters.

    Parameters
    ----------
    rng
        Draws the parameters anywhere within their intervals; equal generators give equal drives. By
        default they are those identified.

    Returns
    -------
    BeltDrive
        The drive.

    Examples
    --------
    >>> f"roller of {200 * identified_drive().roller_radius_m:.0f} cm diameter"
    'roller of 20 cm diameter'
    """

    def choose(row: dict[str, float]) -> float:
        return row["value"] if rng is None else rng.uniform(row["low"], row["high"])

    table = tomllib.loads(PARAMETERS_TOML.read_text(encoding="utf-8"))
    lines = [RotatingLine(x["turns_per_m"], choose(x["moment_kg"])) for x in table.pop("lines")]
    return BeltDrive(**{name: choose(row) for name, row in table.items()}, lines=tuple(lines))


INTERNAL_HZ: Final = 250.0
"""At which the drive is solved; its fastest mode is some 30 Hz. Outputs are interpolated."""


@dataclass(frozen=True, slots=True)
class BeltMotion:
    """What a belt does, and what it does to the assembly that carries it; (N,) each.

    Attributes
    ----------
    speed
        True speed of the belt's surface, positive backwards as in walking [m/s].
    reported_speed
        What the drive reports: the driving roller's speed, low-passed, held and late; without
        noise [m/s].
    pitch_moment
        About the lab's left axis through the platform's origin, with the sign of an action on a
        person standing there [N·m].
    forward_force, upward_force
        Of unbalanced rollers, same sign [N]; their pitch moment is in ``pitch_moment``.
    motor_force
        Of the motor at the belt's surface [N].
    """

    speed: Array
    reported_speed: Array
    pitch_moment: Array
    forward_force: Array
    upward_force: Array
    motor_force: Array


def run_belt(
    drive: BeltDrive,
    command: Array,
    rate_hz: float,
    rng: np.random.Generator,
    weight: Array | None = None,
    push: Array | None = None,
) -> BeltMotion:
    """Let a drive follow a commanded speed.

    Parameters
    ----------
    drive
        Its parameters.
    command
        Commanded speed, (N,) [m/s]; the belt begins at the steady state of the first.
    rate_hz
        Sampling rate of all arrays [Hz].
    rng
        Source of the rollers' angles at the start, and of the rumble.
    weight
        Vertical force of people on the belt, which presses it on its board, (N,) [N].
    push
        Force of people on the belt against its direction, (N,) [N].

    Returns
    -------
    BeltMotion
        At ``rate_hz``.

    Raises
    ------
    ValueError
        The command asks for more force than the motor has, for long.

    Notes
    -----
    Between instants of `INTERNAL_HZ` the linear part is solved exactly. Friction, creep and the
    motor's limit are solved with it by iteration over the whole trial.

    Examples
    --------
    >>> import numpy as np
    >>> from pipeline.virtual_lab.machine.belts import identified_drive
    >>> rng = np.random.default_rng(1)
    >>> motion = run_belt(identified_drive(), np.full(2000, 1.3), 1000.0, rng)
    >>> f"{motion.speed[-1]:.3f} m/s by {motion.motor_force[-1]:.0f} N"
    '1.300 m/s by 33 N'
    """
    time = np.arange(len(command)) / rate_hz
    count = int(np.ceil(time[-1] * INTERNAL_HZ)) + 2
    inside = np.arange(count) / INTERNAL_HZ
    # a new command every 10 ms
    w = np.interp(np.floor(inside * BELTS.command_rate + 1e-9) / BELTS.command_rate, time, command)
    loads = [np.zeros(count) if x is None else np.interp(inside, time, x) for x in (weight, push)]
    solved = _solve(drive, w, *loads)

    def at(values: Array) -> Array:
        return np.interp(time, inside, values)

    speed = at(solved.belt)
    angles, noise, channel = rng.spawn(3)
    travel = np.cumsum(solved.roller) / INTERNAL_HZ
    forward, upward, unbalance = _unbalance(drive, at(solved.roller), at(travel), angles)
    # what angular momentum changes: m r v of each part, of the motor by how fast it turns
    motor_kg = drive.motor_kg / drive.motor_turns
    momentum = drive.roller_radius_m * (
        (drive.turning_kg - drive.idler_kg + motor_kg) * solved.roller_acceleration
        + drive.idler_kg * solved.belt_acceleration
    )
    return BeltMotion(
        speed,
        _reported(drive, solved.roller, inside, time, channel),
        unbalance - at(momentum) + _rumble(drive, speed, rate_hz, noise),
        forward,
        upward,
        at(solved.force),
    )


def _reported(
    d: BeltDrive, speed: Array, inside: Array, time: Array, rng: np.random.Generator
) -> Array:
    """Give the driving roller's speed as the drive reports it, (N,) [m/s]."""
    # low-passed, then the value at each report, which is late and uneven and holds until the next
    keep = np.exp(-1 / (INTERNAL_HZ * max(d.report_lag_s, 1e-9)))
    smooth, _ = lfilter([1 - keep], [1, -keep], speed, zi=[keep * speed[0]])
    number = np.floor(time * d.report_hz + 1e-9).astype(int)
    late = d.report_delay_s + d.report_jitter_s * rng.normal(size=number[-1] + 1)
    return np.asarray(np.interp(number / d.report_hz - late[number], inside, smooth))


class _Solution(NamedTuple):
    """Speeds of driving roller and belt [m/s], motor force [N], and accelerations [m/s²]."""

    roller: Array
    belt: Array
    force: Array
    roller_acceleration: Array
    belt_acceleration: Array


def _matrices(d: BeltDrive) -> tuple[Array, Array]:
    """Give the linear system, (5, 5) and (5, 5).

    States: speeds of the motor with the driving roller and of the belt with the other roller; belt
    and motor force; the controller's integral. Inputs: command, friction of the motor's side and of
    the belt, slip speed, and what the limit takes from the motor's force.
    """
    # m v̇ = F - N + c (u - v), i u̇ = N - c (u - v), Ṅ = k (v - u) - k slip; and the PI controller
    m, i = d.motor_kg + d.turning_kg - d.idler_kg, d.idler_kg
    omega = 2 * np.pi * d.belt_hz
    k, c = i * omega**2, 2 * d.belt_damping * i * omega
    kp, ki, lag = *d.gains, d.torque_lag_s
    A = np.array(
        [
            [-c / m, c / m, -1 / m, 1 / m, 0],
            [c / i, -c / i, 1 / i, 0, 0],
            [k, -k, 0, 0, 0],
            [-kp / lag, 0, 0, -1 / lag, ki / lag],
            [-1, 0, 0, 0, 0],
        ]
    )
    B = np.zeros((5, 5))
    B[0, 1], B[1, 2], B[2, 3] = -1 / m, -1 / i, -k
    B[3, 0], B[4, 0] = kp / lag, 1
    B[3, 4], B[4, 4] = -1 / lag, -1 / kp
    return A, B


def _solve(d: BeltDrive, command: Array, weight: Array, push: Array) -> _Solution:
    """Iterate between the linear system and its friction, creep and limits.

    Half of friction's largest slope is in the linear system: the rest then converges, for what a
    passive system answers to it is smaller than what it was.
    """
    A, B = _matrices(d)
    steepest = np.array([d.static_n, d.board_friction * weight.max(initial=0.0)]) / d.smooth_mps
    bearing, board = steepest / 2
    A[0, 0] += bearing * B[0, 1]
    A[1, 1] += board * B[1, 2]
    inputs, states = np.zeros((2, 5, len(command)))
    inputs[0] = states[:2] = command
    kp, ki = d.gains
    on_board = d.board_friction * np.maximum(weight, 0)
    # until friction, slip and limited force change by less than 0.1 N; beyond 1e6 N they diverge
    for _ in range(60):
        asked = kp * (command - states[0]) + ki * states[4]
        new = np.stack(
            [
                command,
                d.bearing_friction(states[0]) - bearing * states[0],
                on_board * np.tanh(states[1] / d.smooth_mps) + push - board * states[1],
                np.abs(states[0]) * states[2] / d.stretch_n,
                asked - np.clip(asked, -d.max_force_n, d.max_force_n),
            ]
        )
        change = float(np.max(np.abs(new[1:] - inputs[1:]).max(axis=1) * [1, 1, kp, 1]))
        inputs = new
        states = _respond(A, B, inputs)
        if change < 0.1:
            rates = A[:2] @ states + B[:2] @ inputs
            return _Solution(states[0], states[1], states[3], *rates)
        if change > 1e6:
            break
    raise ValueError(
        f"belt: the motor's {d.max_force_n:g} N do not follow the command; give the drive a larger "
        "max_force_n or command smaller accelerations"
    )


def _respond(A: Array, B: Array, inputs: Array) -> Array:
    """Give the states of a stable linear system, (n, N), that begins in its steady state.

    Every mode is a recursion of first order, exact for inputs that are linear between samples.
    """
    values, vectors = np.linalg.eig(A)
    drives = np.linalg.solve(vectors, B.astype(complex)) @ inputs
    states = np.zeros((len(A), inputs.shape[1]))
    for mode, vector, drive in zip(values, vectors.T, drives, strict=True):
        if mode.imag < 0:  # counted with its conjugate
            continue
        x = mode / INTERNAL_HZ
        grown = np.exp(x)
        # weights of the input at the end and the beginning of a step, ∫ e^(λ(h-t)) u(t) dt
        late = (grown - 1 - x) / (x * mode)
        early = (grown - 1) / mode - late
        steps = early * np.concatenate([[0], drive[:-1]]) + late * drive
        steps[0] = -drive[0] / mode
        z = lfilter([1], [1, -grown], steps)
        both = (2 if mode.imag > 0 else 1) * vector[:, None]
        states += both.real * z.real - both.imag * z.imag
    return states


def _unbalance(
    d: BeltDrive, speed: Array, travel: Array, rng: np.random.Generator
) -> tuple[Array, Array, Array]:
    """Give forward and upward force and pitch moment of what turns out of balance, (N,) each.

    The rollers' angles at the start are drawn: where a belt creeps, they drift apart.
    """
    square, turn = speed**2, 2 * np.pi * travel
    forward, upward, moment = 0 * speed, 0 * speed, 0 * speed
    # a force that turns with each roller; its moment about the left axis is z Fx - x Fz
    for x in (d.roller_place_m, -d.roller_place_m):
        angle = rng.uniform(0, 2 * np.pi) + d.turns_per_m * turn
        ahead, up = (d.unbalance_kg_per_m * square * f(angle) for f in (np.cos, np.sin))
        forward, upward = forward + ahead, upward + up
        moment = moment + d.roller_height_m * ahead - x * up
    for line in d.lines:
        angle = rng.uniform(0, 2 * np.pi) + line.turns_per_m * turn
        moment = moment + line.moment_kg * square * np.cos(angle)
    return forward, upward, moment


def _rumble(d: BeltDrive, speed: Array, rate_hz: float, rng: np.random.Generator) -> Array:
    """Give the broad-band moment of a running belt, (N,) [N·m]."""
    # white noise of that density up to half the sampling rate, low-passed where the rumble ends
    white = d.rumble_nm_per_sqrt_hz * np.sqrt(rate_hz / 2) * rng.normal(size=len(speed))
    if rate_hz > 2 * BELTS.rumble_end:
        white = sosfilt(butter(2, BELTS.rumble_end, fs=rate_hz, output="sos"), white)
    return np.asarray(white * np.minimum(np.abs(speed) / BELTS.rumble_speed, 1))


def run_linear_belt(machine: Machine, command: Array, rate_hz: float) -> BeltMotion:
    """Let a belt follow a commanded speed as a linear system; its motion is reported as it is.

    Its pitch moment answers to its acceleration by a second-order response, as Hnat and van den
    Bogert (2014) found it.
    """
    speed = follow(command, machine.servo_hz, rate_hz)[0]
    acceleration = np.gradient(speed, 1 / rate_hz)
    omega = 2 * np.pi * machine.belt_hz
    numerator = np.array([-(omega**2) * machine.belt_moment_kg_m])
    denominator = np.array([1, 2 * machine.belt_damping * omega, omega**2])
    b, a, _ = cont2discrete((numerator, denominator), 1 / rate_hz, method="bilinear")
    moment, none = np.asarray(lfilter(b.ravel(), a, acceleration)), 0 * speed
    return BeltMotion(speed, speed, moment, none, none, none)


Drives = tuple[BeltDrive, BeltDrive]


def make_drives(faults: BeltFaults, rng: np.random.Generator) -> Drives | None:
    """Draw the motors of a laboratory's two belts; None for belts that answer linearly."""
    if faults.drive == "linear":
        return None
    left, right = (
        replace(
            drive,
            unbalance_kg_per_m=faults.unbalance_kg_per_m,
            rumble_nm_per_sqrt_hz=faults.roughness * drive.rumble_nm_per_sqrt_hz,
            report_jitter_s=faults.roughness * drive.report_jitter_s,
            lines=tuple(x._replace(moment_kg=faults.roughness * x.moment_kg) for x in drive.lines),
        )
        for drive in map(identified_drive, rng.spawn(2))
    )
    return left, right


def run_belts(
    machine: Machine,
    drives: Drives | None,
    command: Array,
    rate_hz: float,
    rng: np.random.Generator,
    people: Pair | None = None,
) -> tuple[BeltMotion, BeltMotion]:
    """Let both belts follow a commanded speed under what people do to them.

    Parameters
    ----------
    machine
        The treadmill.
    drives
        Of the left and the right belt; None for belts that answer linearly.
    command
        (N,) [m/s].
    rate_hz
        Sampling rate [Hz].
    rng
        Source of the rollers' angles and of the rumble.
    people
        Ground reaction of the left and the right plate on people, (N, 6) each [N, N·m].

    Returns
    -------
    tuple of BeltMotion
        Left and right.
    """
    motions = []
    for k, of_belt in enumerate(rng.spawn(2)):
        if drives is None:
            motions.append(run_linear_belt(machine, command, rate_hz))
        else:
            load = np.zeros((len(command), 6)) if people is None else people[k]
            # people press the belt on its board, and push it forward, against its motion
            weight, push = np.maximum(load[:, 2], 0.0), -load[:, 0]
            motions.append(run_belt(drives[k], command, rate_hz, of_belt, weight, push))
    return motions[0], motions[1]


def carried_of_belts(belts: tuple[BeltMotion, BeltMotion]) -> Pair:
    """Give what the plates have to carry of their belts, about the platform's origin.

    The forces act in the middle of the belt; (N, 6) each [N, N·m], with the sign of an action on a
    person standing there.
    """
    wrenches = []
    for belt, y in zip(belts, (PLATE.width / 2, -PLATE.width / 2), strict=True):
        zero = np.zeros(len(belt.speed))
        # moments of forces at (0, y, 0): y Fz and -y Fx
        columns = [belt.forward_force, zero, belt.upward_force]
        columns += [y * belt.upward_force, belt.pitch_moment, -y * belt.forward_force]
        wrenches.append(np.column_stack(columns))
    return wrenches[0], wrenches[1]
