"""Which foot stood on which plate, contact by contact, by the centre of pressure."""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Final, Literal, NamedTuple

import numpy as np

from compensation import center_of_pressure
from hbm.body import Body
from hbm.coordinates import COORDINATES
from hbm.motion import Motion
from hbm.notes import Note
from hbm.poses import joint_positions
from hbm.signals.filtering import Method
from hbm.signals.samples import median_of, stretches
from hbm.spatial import Array, Mask
from pipeline.config.schema import PlateContact
from pipeline.trial.gait.events import SIDES

MIN_DISTANCE_DIFFERENCE_M: Final = 0.1
"""How much nearer a foot must be: one that swings may pass a shoe's length from the pressure."""
MAX_PRESSURE_DISTANCE_M: Final = 0.2
"""Farther from the middle of a foot, ankle to toes, there is no pressure under it."""
MAX_HEIGHT_DIFFERENCE_M: Final = 0.03
"""Two feet that both stand are level; one that swings past is not."""


class Pressure(NamedTuple):
    """The pressure on one plate beside the feet.

    Attributes
    ----------
    loaded
        Whether there is a centre of pressure, (T,).
    distance
        From it to the middle of the left and the right foot, (T, 2) [m]; 0 without load.
    nearer
        The nearer foot, 0 left and 1 right, (T,).
    decided
        Whether that foot is nearer by so much that the load is its own, (T,).
    uncertain
        Whether the load lies under neither foot, or between two that both stand, (T,).
    """

    loaded: Mask
    distance: Array
    nearer: Array
    decided: Mask
    uncertain: Mask


def pressure_beside(wrench: Array, feet: Array, threshold_n: float) -> Pressure:
    """Find the pressure on a plate beside the feet.

    Parameters
    ----------
    wrench
        Of the plate, lab axes about the lab origin, (T, 6) [N, N·m].
    feet
        Middle of the left and the right foot in the lab, (T, 2, 3) [m].
    threshold_n
        Vertical force above which the plate is loaded [N].

    Returns
    -------
    Pressure
        Frames in which wrench or feet are unknown are not loaded.
    """
    surface = feet[..., 2].min(axis=1)
    pressure = center_of_pressure(wrench, threshold_n, surface)[:, :2]
    apart = feet[..., :2] - pressure[:, None]
    distance = np.sqrt(np.square(apart).sum(axis=-1))
    loaded: Mask = np.isfinite(distance).all(axis=1)
    distance = np.where(loaded[:, None], distance, 0.0)
    left, right = distance.T
    undecided = np.abs(left - right) < MIN_DISTANCE_DIFFERENCE_M
    level = np.abs(feet[:, 1, 2] - feet[:, 0, 2]) < MAX_HEIGHT_DIFFERENCE_M
    under_none = np.minimum(left, right) > MAX_PRESSURE_DISTANCE_M
    return Pressure(
        loaded,
        distance,
        (right < left).astype(int),
        loaded & ~undecided,
        loaded & (under_none | (undecided & level)),
    )


Foot = Literal["left_foot", "right_foot"]
FEET: Final[tuple[Foot, Foot]] = ("left_foot", "right_foot")
LEGS: Final = ("Hip", "Knee", "Ankle", "Foot", "Toe")
"""Joints of a leg, as the names of their coordinates begin after the side."""
MIN_STANCE_S: Final = 0.1
"""No foot stands for less: a shorter stretch of pressure near it is noise of a light load."""
MAX_DOUBTFUL_SHARE: Final = 0.5
"""Of a contact: where more of it is uncertain, all of it is."""
FAR_M: Final = 0.5
"""No centre of pressure is so far from the feet: corners, units or moments are wrong."""
MAX_CONTACTS_NAMED: Final = 8
"""In a note; the frames of all are marked."""


@dataclass(frozen=True, slots=True)
class Contact:
    """A stretch of frames in which a plate is loaded.

    Attributes
    ----------
    plate
        Number of the plate in the file.
    start, stop
        First frame, and the one after the last.
    feet
        Whose it is, in order; two where the foot changes while the plate stays loaded.
    changes
        First frame of every foot but the first.
    ambiguous
        Whether most of it cannot be assigned: the pressure lies under neither foot, or between two
        feet that both stand.
    distance_m
        Of the centre of pressure from the middle of the nearer foot, the median.
    """

    plate: int
    start: int
    stop: int
    feet: tuple[Foot, ...]
    ambiguous: bool
    distance_m: float
    changes: tuple[int, ...] = ()


@dataclass(frozen=True, slots=True)
class SharedPlates:
    """The wrenches of the plates by foot.

    Attributes
    ----------
    by_foot
        "left_foot" and "right_foot" -> wrench, (T, 6); their sum is the plates' sum at any time.
    ambiguous
        Frames in which the split between the feet is uncertain, (T,).
    contacts
        All contacts in order of plate and time.
    foot_of_plates
        Per plate whose foot it carries in each frame, 0 left and 1 right, (T,).
    """

    by_foot: Mapping[str, Array]
    ambiguous: Mask
    contacts: tuple[Contact, ...]
    foot_of_plates: tuple[Array, ...] = ()


def feet_of(body: Body, motion: Motion) -> Array:
    """Give the middle of the left and right foot, ankle to toes, in the lab, (T, 2, 3) [m]."""
    names = [f"{side}_{part}" for side in ("left", "right") for part in ("foot", "toes")]
    joints = joint_positions(body, motion.q, names)
    return np.asarray((joints[:, 0::2] + joints[:, 1::2]) / 2)


def share_between_feet(
    time: Array,
    wrenches: Sequence[Array],
    feet: Array,
    threshold_n: float,
    *,
    numbers: Sequence[int] | None = None,
    stated: Sequence[PlateContact] = (),
    method: Method = "zero_phase",
) -> SharedPlates:
    """Give each plate's wrench to the foot that stood on it.

    Parameters
    ----------
    time
        (T,) [s].
    wrenches
        Per plate, action on the subject in lab axes about the lab origin, (T, 6) [N, N·m]. Where a
        moving platform's inertia is in others, these are of the subject alone, and the others are
        given to the same feet (`by_foot`).
    feet
        Middle of the left and the right foot in the lab, (T, 2, 3) [m].
    threshold_n
        Vertical force above which a plate is loaded [N].
    numbers
        Of the plates in the file, which may lack some; by default from 1.
    stated
        Contacts whose foot a person states; they overrule the centre of pressure.
    method
        With "realtime" the foot of a frame depends on no later one.

    Returns
    -------
    SharedPlates
        Wrenches by foot, doubtful frames, contacts.

    Raises
    ------
    ValueError
        If a stated time is not in the recording or has no contact, two statements about a contact
        contradict each other, or there is no such plate.

    Notes
    -----
    A loaded frame belongs to the foot whose middle is nearer to the centre of pressure by
    ``MIN_DISTANCE_DIFFERENCE_M`` at least. Within a contact, stretches of one foot that are shorter
    than ``MIN_STANCE_S`` do not count beside longer ones. Of the frames between two stretches,
    unloaded or undecided, each half belongs to the nearer one's foot. In real time no stretch is
    too short, all frames between two belong to the first one's foot, and frames alone are doubtful,
    not whole contacts. Residuals do not depend on this choice, joint moments do.
    """
    numbers = numbers or range(1, len(wrenches) + 1)
    require_contacts(stated, numbers, time)
    live, ambiguous = method == "realtime", np.zeros(len(feet), bool)
    contacts, foot_of_plates = list[Contact](), list[Array]()
    for number, wrench in zip(numbers, wrenches, strict=True):
        plate = _Plate(time, wrench, feet, threshold_n)
        if not live:
            plate.drop_brief()
        plate.overrule([each for each in stated if each.plate == number])
        foot_index = plate.last_foot_of_frames() if live else plate.foot_of_frames()
        doubtful = plate.uncertain.copy()
        contacts += plate.contacts(number, foot_index)
        ambiguous |= doubtful if live else plate.uncertain
        foot_of_plates.append(foot_index)
    under = by_foot(np.stack(wrenches, axis=1), np.stack(foot_of_plates, axis=1))
    each = dict(zip(FEET, np.moveaxis(under, 1, 0), strict=True))
    return SharedPlates(each, ambiguous, tuple(contacts), tuple(foot_of_plates))


def by_foot(wrenches: Array, on: Array) -> Array:
    """Add up the wrenches of the plates, (..., P, 6), under each foot, (..., 2, 6).

    ``on`` is the foot that each plate carries, 0 left and 1 right, (..., P).
    """
    under = (np.where((on == foot)[..., None], wrenches, 0.0).sum(axis=-2) for foot in range(2))
    return np.stack([*under], axis=-2)


def require_contacts(stated: Iterable[PlateContact], numbers: Sequence[int], time: Array) -> None:
    """Refuse stated contacts of a plate, or at a time, that is not in the recording.

    Parameters
    ----------
    stated
        Contacts whose foot a person states.
    numbers
        Of the plates in the file.
    time
        Of the markers, (T,) [s].

    Raises
    ------
    ValueError
        With the first such contact.
    """
    for each in stated:
        if each.plate not in numbers:
            raise ValueError(
                f"contacts: there is no plate {each.plate}; plates are {numbers[0]} to "
                f"{numbers[-1]}"
            )
        if not time[0] <= each.time_s <= time[-1]:
            raise ValueError(
                f"contacts: {each.time_s:g} s is not in the recording, which lasts from "
                f"{time[0]:.2f} to {time[-1]:.2f} s"
            )


def forces_of_legs(frames: Mask) -> Mask:
    """Give which forces are of the legs' coordinates in some frames, (T,) to (T, 46)."""
    of_leg = np.array([name[1:].startswith(LEGS) for name in COORDINATES])
    return np.asarray(frames[:, None] & of_leg)


def contact_notes(shared: SharedPlates, time: Array) -> tuple[Note, ...]:
    """Name contacts that cannot be assigned to a foot, and plates with pressure far from both."""
    notes = []
    for plate in sorted({contact.plate for contact in shared.contacts}):
        distance_m = float(np.median([c.distance_m for c in shared.contacts if c.plate == plate]))
        if distance_m > FAR_M:
            notes.append(Note.of("pressure_far_from_feet", plate=plate, distance_m=distance_m))
    doubtful = [(contact.start, contact.stop) for contact in shared.contacts if contact.ambiguous]
    if doubtful:
        times = _listed(time, doubtful)
        notes.append(Note.of("contacts_ambiguous", contacts=len(doubtful), times=times))
    return tuple(notes)


class _Plate:
    """One plate's load over time, and the foot of each frame as far as it is decided."""

    def __init__(self, time: Array, wrench: Array, feet: Array, threshold_n: float) -> None:
        pressure = pressure_beside(wrench, feet, threshold_n)
        self.time, self.distance, self.nearer = time, pressure.distance, pressure.nearer
        self.decided: Mask = pressure.decided
        self.uncertain: Mask = pressure.uncertain
        self.stretches = [(int(a), int(b)) for a, b in stretches(pressure.loaded)]

    def drop_brief(self) -> None:
        """Leave brief stretches of one foot undecided beside a longer one of the same contact."""
        for start, stop in self.stretches:
            decided = start + np.flatnonzero(self.decided[start:stop])
            runs = np.split(decided, np.flatnonzero(np.diff(self.nearer[decided])) + 1)
            lasting = [np.ptp(self.time[run]) if len(run) else 0.0 for run in runs]
            if max(lasting) < MIN_STANCE_S:
                continue
            for run, duration in zip(runs, lasting, strict=True):
                cut_off = run[0] == 0 or run[-1] == len(self.time) - 1
                if duration < MIN_STANCE_S and not cut_off:
                    self.decided[run] = False

    def overrule(self, stated: Sequence[PlateContact]) -> None:
        """Take the foot of a contact from a person."""
        said: dict[int, PlateContact] = {}
        for each in stated:
            frame = int(np.argmin(np.abs(self.time - each.time_s)))
            inside = [(a, b) for a, b in self.stretches if a <= frame < b]
            if not inside:
                loaded = _listed(self.time, self.stretches) or "never"
                raise ValueError(
                    f"contacts: nobody is on plate {each.plate} at {each.time_s:g} s; it is "
                    f"loaded: {loaded}"
                )
            contact = self._by_one_foot(frame, *inside[0])
            before = said.setdefault(contact.start, each)
            if before.foot != each.foot:
                raise ValueError(
                    f"contacts: plate {each.plate} carries the {before.foot} foot at "
                    f"{before.time_s:g} s and the {each.foot} one at {each.time_s:g} s, but that "
                    "is one contact; state one of them"
                )
            self.nearer[contact] = SIDES.index(each.foot)
            self.decided[contact] = True
            self.uncertain[contact] = False

    def _by_one_foot(self, frame: int, start: int, stop: int) -> slice:
        """Give the part of a contact around a frame in which the foot does not change, if known."""
        if np.mean(self.uncertain[start:stop]) > MAX_DOUBTFUL_SHARE:
            return slice(start, stop)
        foot = self.foot_of_frames()[start:stop]
        changes = start + np.flatnonzero(np.diff(foot)) + 1
        bounds = np.concatenate([[start], changes, [stop]])
        part = int(np.searchsorted(bounds, frame, side="right"))
        return slice(int(bounds[part - 1]), int(bounds[part]))

    def foot_of_frames(self) -> Array:
        """Give the foot of every frame, 0 left and 1 right, (T,)."""
        known = np.flatnonzero(self.decided)
        if not len(known):
            return np.asarray(self.nearer)
        nearest = known[np.searchsorted((known[1:] + known[:-1]) / 2, np.arange(len(self.time)))]
        return np.asarray(self.nearer[nearest])

    def last_foot_of_frames(self) -> Array:
        """Give the foot that was decided last in every frame, 0 left and 1 right, (T,)."""
        frames = np.arange(len(self.time))
        last = np.maximum.accumulate(np.where(self.decided, frames, -1))
        return np.asarray(self.nearer[np.where(last < 0, frames, last)])

    def contacts(self, number: int, foot_index: Array) -> list[Contact]:
        """List the contacts with their feet; one that is mostly uncertain is so throughout."""
        found, nearest = [], self.distance.min(axis=1)
        for start, stop in self.stretches:
            if self.time[stop - 1] - self.time[start] < MIN_STANCE_S:
                continue
            own = foot_index[start:stop]
            first = np.flatnonzero(np.diff(own, prepend=-1))
            doubtful = np.mean(self.uncertain[start:stop]) > MAX_DOUBTFUL_SHARE
            feet = tuple(FEET[k] for k in own[first])
            changes = tuple(int(start + k) for k in first[1:])
            nearest_m = median_of(nearest[start:stop])
            contact = Contact(number, start, stop, feet, bool(doubtful), nearest_m, changes)
            found.append(contact)
            if doubtful:
                self.uncertain[start:stop] = True
        return found


def _listed(time: Array, stretches: Sequence[tuple[int, int]]) -> str:
    """Name the times of stretches, the first ones of many."""
    named = [f"{time[a]:.2f}–{time[b - 1]:.2f} s" for a, b in stretches[:MAX_CONTACTS_NAMED]]
    more = ["…"] if len(stretches) > MAX_CONTACTS_NAMED else []
    return ", ".join([*named, *more])
