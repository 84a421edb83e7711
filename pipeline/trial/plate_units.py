"""Units of plates by the subject on them: powers of ten are of units, not of geometry."""

from collections.abc import Sequence
from dataclasses import replace
from typing import Final, NamedTuple

import numpy as np

from hbm.body import Body
from hbm.numbers import read_numbers
from hbm.signals.samples import median_of
from hbm.spatial import GRAVITY_MPS2, WRENCH_COMPONENTS, Array, shift_wrench
from pipeline.io.axes import MIN_MEAN_LOAD_N, find_sites, mean_force
from pipeline.io.mended_plates import mended_plates, of_channels
from pipeline.io.read_options import CONVERT, correction, parse_plate_units
from pipeline.io.recording import Fact, Plate, Recording
from pipeline.trial.subject import LIMITS as SUBJECT

LIMITS: Final = read_numbers("pipeline.trial", "thresholds.toml", "plate_units")

POWERS: Final = (
    *((k, k) for k in range(-3, 4)),
    *(pair for k in (-3, -2, 2, 3) for pair in ((k, 0), (0, k))),
)
"""Of ten, by which the moments may be too small that show where along x and y the pressure is."""


class Factor(NamedTuple):
    """By which powers of ten forces and moments of a plate are too small; 0 if right.

    None for moments of which one has another unit than the others. Of a force at a centre of
    pressure, ``moment`` is of the latter and ``torque`` of the free torque.
    """

    plate: Plate
    force: int
    moment: int | None
    torque: int = 0

    @property
    def at_pressure(self) -> bool:
        """Whether moments are of forces at centres of pressure."""
        return self.plate.units.count(",") == 2


def require_units(recording: Recording, mass_kg: float | None = None) -> None:
    """Refuse plates in wrong units, and say which are right.

    Parameters
    ----------
    recording
        The trial, or another recording of the subject.
    mass_kg
        Body mass as stated; by default that of the file.

    Raises
    ------
    ValueError
        The vertical force is that of no body, or the pressure is 10, 100 or 1000 times nearer to
        the centre of the plate than the feet on it, or farther. It names units or gains with which
        it is under the feet.
    """
    mass_kg, time = mass_kg or recording.metadata.mass_kg, recording.markers.time
    feet = _feet(recording)
    # first of all plates together, since each may carry a part of a person
    ten = _tenfold(recording.plates, time, mass_kg)
    factors = [_factor(plate, feet, time, mass_kg, ten) for plate in recording.plates]
    factors = [_with_torque(factor) for factor in _with_unsure(factors, feet, time)]
    of_plates = dict[str, list[str]]()
    for factor in factors:
        plate, force, moment, torque = factor
        arm = "centres of pressure" if factor.at_pressure else "moments"
        for quantity, power in (("forces", force), (arm, moment), ("free torques", torque)):
            size = "small" if (power or 0) > 0 else "large"
            fault = f"{10 ** abs(power)} times too {size}" if power else "in different units"
            if power != 0:
                of_plates.setdefault(f"{quantity} {fault}", []).append(str(plate.number))
    wrong = [f"plate {', '.join(numbers)}: {fault}" for fault, numbers in of_plates.items()]
    if wrong:
        faults = f"{', '.join(wrong)}, by the subject{f' of {mass_kg:.3g} kg' if mass_kg else ''}"
        raise ValueError(f"{recording.source.name}: {faults} on them; {_remedy(factors)}")


def reversed_plates(recording: Recording) -> dict[int, Fact]:
    """Say which plates pull the subject down; what brings them under the feet mends them."""
    facts, feet = dict[int, Fact](), _feet(recording)
    for plate in recording.plates:
        # a plate that measures what it exerts on the ground, or with one sign wrong
        pull_n = -float(plate.rotation[2] @ mean_force(plate.wrench_in_plate[:, :3]))
        if pull_n < MIN_MEAN_LOAD_N:
            continue
        off = {
            deed: _off(*_pressure_and_feet(mended, feet, recording.markers.time), 0)
            for deed in (f"{plate.number}: reverse {what}" for what in ("all", "Fz"))
            for mended in mended_plates([plate], [deed])
        }
        remedy = correction(min(off, key=lambda deed: off[deed]))
        doubt = f"it pulls the subject down by {pull_n:.0f} N on average: set {remedy}"
        facts[plate.number] = Fact("in_doubt", f"plate {plate.number}", doubt)
    return facts


def _feet(recording: Recording) -> Array:
    """Give the markers of the feet, (T, M, 3) [m]."""
    markers = recording.markers
    return markers.position[:, find_sites(markers.names, recording.options.marker_set).low]


def require_possible(residual: Array, body: Body) -> None:
    """Refuse a residual, (T, 6) [N, N·m], as no body has; a ValueError says how large it is."""
    if not len(residual):
        return
    weight_n = body.mass * GRAVITY_MPS2
    # RMS of the three forces, and of the three moments
    rms = np.sqrt(np.mean(np.square(residual), axis=0)).reshape(2, 3)
    force_n, moment_nm = np.linalg.norm(rms, axis=1).tolist()
    most_n, most_nm = np.multiply(
        LIMITS.largest_residual, [weight_n, weight_n * body.height_m]
    ).tolist()
    if force_n > most_n or moment_nm > most_nm:
        raise ValueError(
            f"the residual is {force_n:,.0f} N and {moment_nm:,.0f} N·m RMS, more than any body "
            f"has ({most_n:,.0f} N, {most_nm:,.0f} N·m): units or places of the plates are wrong"
        )


def _with_unsure(factors: Sequence[Factor], feet: Array, time: Array) -> list[Factor]:
    """Give plates that are right or not by themselves the moments that others surely have.

    These bring the pressure nearer to the feet, if not by so much that the plate alone shows it.
    """
    # one power of ten that is common to all plates that show one
    sure = {factor.moment for factor in factors if factor.moment}
    if len(sure) != 1:
        return list(factors)
    common = sure.pop()
    # smaller moments bring any pressure nearer: only one that is far away needs them
    far_m = LIMITS.far if common < 0 else 0.0
    given = []
    for factor in factors:
        rows = _pressure_and_feet(factor.plate, feet, time)
        unsure = factor.force == factor.moment == 0
        nearer = unsure and max(far_m, _off(*rows, common)) < _off(*rows, 0)
        given.append(factor._replace(moment=common) if nearer else factor)
    return given


def _remedy(factors: Sequence[Factor]) -> str:
    """Give the units that are right for all plates, else gains of single plates."""
    right = {_units(factor) for factor in factors}
    if len(right) == 1 and (units := right.pop()):
        return f'give --plate-units {units}, or plate_units = "{units}" in study.toml'
    # no unit explains it for all plates: channels of single plates
    wrong = [factor for factor in factors if factor[1:] != (0, 0, 0)]
    gains = [
        f"{plate.number}: gain {name} {10.0**power:g}"
        for plate, force, moment, _ in wrong
        for name, power in zip(WRENCH_COMPONENTS, (*[force] * 3, *[moment] * 3), strict=True)
        if power
    ]
    # a gain of moments changes free torques too
    mixed = any(factor.at_pressure or factor.moment is None for factor in wrong)
    # more than six gains would hide what is wrong
    gain = "" if mixed or len(gains) > 6 else f", or set {correction(*gains)}"
    return f"correct these channels or columns and export the file again{gain}"


def _units(factor: Factor) -> str:
    """Give the units in which a plate is right; empty where they are not known."""
    if not factor.plate.units or factor.moment is None:
        return ""
    units, right = parse_plate_units(factor.plate.units), list[str]()
    # moments of forces at centres of pressure are in the unit of these
    powers = (factor.force, factor.torque, factor.moment)[:: 1 if factor.at_pressure else 2]
    # usual units of forces, moments and centres of pressure, in the order of `CONVERT`
    usual = ("N", "kN"), ("Nmm", "Ncm", "Nm", "kNm"), ("mm", "cm", "m")
    of_quantities = zip(CONVERT.values(), usual, units, powers, strict=False)
    for convert, symbols, unit, ten in of_quantities:
        right_unit = convert(unit) * 10.0**ten
        right += [u for u in (unit, *symbols) if np.isclose(convert(u), right_unit)][:1]
    return ",".join(right) if len(right) == len(units) else ""


def _with_torque(factor: Factor) -> Factor:
    """Give a plate with the power of ten of its free torques, which only friction limits."""
    wrench = factor.plate.wrench_in_plate[np.isfinite(factor.plate.wrench_in_plate).all(axis=1)]
    if not factor.at_pressure or not wrench[:, 2].any():
        return factor
    # samples under load, in which the line of the force is known
    size = np.abs(wrench[:, 2])
    force, moment = np.split(wrench[size > LIMITS.loaded * np.percentile(size, 98)].T, 2)
    # along the line of the force, where p × f is zero
    torque = (force * moment).sum(axis=0) / force[2]
    # by the vertical force a torque is a length, which friction limits
    arm_m = float(np.median(np.abs(torque / force[2]))) * 10.0**-factor.force
    return factor._replace(
        torque=-2 - (arm_m > LIMITS.arm_of_newton_millimetres) if arm_m > LIMITS.largest_arm else 0
    )


def _load(vertical: Array) -> tuple[float, float]:
    """Give what a plate reads at most [N] and carries while it is loaded [kg], by its size [N]."""
    highest_n = float(np.percentile(vertical, 98))
    return highest_n, median_of(vertical[vertical >= LIMITS.loaded * highest_n]) / GRAVITY_MPS2


def _tenfold(plates: Sequence[Plate], time: Array, mass_kg: float | None) -> int:
    """Give the power of ten, 1 or -1, by which all plates together miss a body's mass; or 0."""
    # at the markers' times, since plates may be sampled at different ones
    loads = [np.interp(time, p.time, np.abs(p.wrench_in_plate[:, 2])) for p in plates]
    load_kg = _load(np.nan_to_num(np.sum(loads, axis=0)))[1] if loads else 0.0
    if mass_kg is None:
        return int(LIMITS.largest_drift <= load_kg < SUBJECT.least_mass)
    power = np.log10(mass_kg / load_kg) if load_kg > LIMITS.largest_drift else 0.0
    return round(power) if abs(abs(power) - 1) < LIMITS.near_tenfold else 0


def _factor(plate: Plate, feet: Array, time: Array, mass_kg: float | None, ten: int) -> Factor:
    """Find the powers of ten of a plate: of its load, then of where its pressure is.

    ``ten`` is that of all plates together, where they miss a body.
    """
    vertical = np.abs(plate.wrench_in_plate[:, 2])
    vertical = vertical[np.isfinite(vertical)]
    if not vertical.any():
        return Factor(plate, 0, 0)
    highest_n, load_kg = _load(vertical)
    for power in [ten] if ten else _load_powers(load_kg, mass_kg):
        # moments of forces at centres of pressure grow with the forces
        scales = 10.0 ** np.repeat([power, power * (plate.units.count(",") == 2)], 3)
        wrench = of_channels(plate, np.diag(scales), plate.wrench_in_plate)
        rows = _pressure_and_feet(replace(plate, wrench_in_plate=wrench), feet, time)
        moment, change = _moment_power(*rows), np.abs(np.diff(vertical))
        # noise of an empty plate may look like a load in another unit
        smooth = change.any() and highest_n > LIMITS.least_smooth * np.median(change[change > 0])
        if power < 0 or (smooth and _off(*rows, moment) < LIMITS.largest_distance):
            return Factor(plate, power, moment)
    return Factor(plate, 0, _moment_power(*_pressure_and_feet(plate, feet, time)))


def _load_powers(load_kg: float, mass_kg: float | None) -> Sequence[int]:
    """Give the powers of ten with which a load is that of a body, if it is not."""
    powers = (
        (3, 2)
        if load_kg < LIMITS.largest_drift
        else (-3, -2, -1)
        if load_kg > LIMITS.largest_load
        else ()
    )
    low, high = SUBJECT.least_mass, LIMITS.largest_load
    if mass_kg is not None:
        low, high = mass_kg * 10**-LIMITS.near_power, mass_kg * 10**LIMITS.near_power
    return [power for power in powers if low <= load_kg * 10.0**power <= high]


def _pressure_and_feet(plate: Plate, feet: Array, time: Array) -> tuple[Array, Array, Array]:
    """Give where pressure and feet are on a plate that carries somebody, plate axes, (K, 2) [m].

    The pressure by the stored moments, what the transducer's place adds, and the feet.
    """
    wrench = np.stack([np.interp(time, plate.time, c) for c in plate.wrench_in_plate.T], axis=1)
    vertical = np.abs(wrench[:, 2])
    is_known = np.isfinite(wrench).all(axis=1)
    is_visible = np.isfinite(feet).all(axis=-1)
    if not (is_known.any() and is_visible.any()):
        return (np.empty((0, 2)),) * 3
    loaded = is_known & (vertical >= LIMITS.loaded * np.percentile(vertical[is_known], 98))
    loaded &= vertical > SUBJECT.least_mass * GRAVITY_MPS2
    # markers of the feet in the axes of the plate
    place = (feet - plate.center) @ plate.rotation
    # those near the ground and over the plate
    standing = is_visible & (
        feet[..., 2] < np.percentile(feet[is_visible][:, 2], 5) + LIMITS.foot_height
    )
    if np.isfinite(plate.corners).all():
        half = np.abs((plate.corners - plate.center) @ plate.rotation)[:, :2].max(axis=0)
        standing &= (np.abs(place[..., :2]) < half + LIMITS.overhang).all(axis=-1)
    loaded &= standing.any(axis=1)
    counted = standing[loaded, :, None]
    # the mean of the markers of feet on the plate
    foot = np.where(counted, place[loaded, :, :2], 0).sum(axis=1) / counted.sum(axis=1)
    # x = -My / Fz and y = Mx / Fz, by stored moments, and about the surface
    loads = wrench[loaded], shift_wrench(wrench[loaded], plate.transducer)
    in_all, by_stored = (load[:, [4, 3]] * [-1, 1] / load[:, 2:3] for load in loads)
    return by_stored, in_all - by_stored, foot


def _moment_power(stored: Array, lever: Array, foot: Array) -> int | None:
    """Give the power of ten of the moments; None where one has another than the others.

    ``stored`` is where the pressure is by the stored moments, ``lever`` what the transducer's place
    adds, (K, 2) [m].
    """
    if len(foot) < LIMITS.fewest_samples or not stored.any(axis=0).all():
        return 0
    # where the stored moments have to put the pressure
    at_foot = foot - lever
    # moments so small that the pressure never moves: their ratio tells the power
    if _rms(stored) < LIMITS.resting_pressure and _rms(foot) > LIMITS.least_foot:
        exponent = float(np.log10(_rms(at_foot) / _rms(stored)))
        return round(exponent) if abs(exponent - round(exponent)) < LIMITS.near_power else 0
    # distance of pressure and feet for each pair of powers along x and y
    moved = 10.0 ** np.array(POWERS)[:, None] * stored + lever - foot
    off = dict(zip(POWERS, _rms(moved).tolist(), strict=True))
    powers = min(POWERS, key=lambda pair: off[pair])
    power = powers[0] or powers[1]
    # one power for all moments, unless two explain far more
    if off[power, power] < LIMITS.same_ratio * off[powers]:
        powers = power, power
    if not power or off[powers] > LIMITS.largest_remainder * off[0, 0]:
        return 0
    wrong = np.flatnonzero(powers)
    certain = off[0, 0] > LIMITS.least_distance
    if power < 0:
        at_foot, at_pressure = at_foot[:, wrong], stored[:, wrong]
        # a wrong zero or place moves the pressure away, but it is no faster there
        moves, foot_moves = (
            _rms(points - points.mean(axis=0)) for points in (at_pressure, at_foot)
        )
        too_fast = moves > 10.0 ** (-power - 0.5) * foot_moves
        near = abs(np.log10(_rms(at_foot) / _rms(at_pressure)) - power) < LIMITS.near_power
        certain = too_fast and near
    return (power if len(wrong) > 1 else None) if certain else 0


def _off(stored: Array, lever: Array, foot: Array, powers: int | tuple[int, int] | None) -> float:
    """Give how far pressures are from feet if moments are larger by powers of ten, RMS [m]."""
    return float(_rms(np.power(10.0, powers or 0) * stored + lever - foot)) if len(foot) else np.inf


def _rms(vectors: Array) -> Array:
    """Give the RMS length of K vectors, (..., K, 2), (...)."""
    return np.asarray(np.sqrt(np.square(vectors).sum(axis=-1).mean(axis=-1)))
