"""Which foot stood on which plate, contact by contact, by the centre of pressure."""

from collections.abc import Iterable, Sequence
from typing import Final, Literal, NamedTuple

import numpy as np

from compensation import center_of_pressure
from hbm.notes import Note
from hbm.numbers import read_numbers
from hbm.signals.filtering import Method
from hbm.signals.samples import median_of, stretches
from hbm.spatial import Array, Indices, Mask
from pipeline.config.schema import PlateContact
from pipeline.trial.gait.events import SIDES

LIMITS: Final = read_numbers("pipeline.trial", "thresholds.toml", "contact")


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
    nearer: Indices
    decided: Mask
    uncertain: Mask


def pressure_beside(
    wrench: Array, feet: Array, threshold_n: float, standing: Mask | None = None
) -> Pressure:
    """Find the pressure on a plate beside the feet.

    Parameters
    ----------
    wrench
        Of the plate, lab axes about the lab origin, (T, 6) [N, N·m].
    feet
        Middle of the left and the right foot in the lab, (T, 2, 3) [m].
    threshold_n
        Vertical force above which the plate is loaded [N].
    standing
        Frames in which no foot swings, (T,); by default those in which the feet are level.

    Returns
    -------
    Pressure
        Frames in which wrench or feet are unknown are not loaded.
    """
    # pressure at the height of the lower foot
    surface = feet[..., 2].min(axis=1)
    pressure = center_of_pressure(wrench, threshold_n, surface)[:, :2]
    away = feet[..., :2] - pressure[:, None]
    distance = np.sqrt(np.vecdot(away, away))
    loaded: Mask = np.isfinite(distance).all(axis=1)
    distance = np.where(loaded[:, None], distance, 0.0)
    left, right = distance.T
    # the nearer foot has to be nearer by far: one that swings past is near, too
    undecided = np.abs(left - right) < LIMITS.least_difference
    if standing is None:
        standing = np.abs(feet[:, 1, 2] - feet[:, 0, 2]) < LIMITS.level_feet
    # under neither foot: somebody else, or wrong moments
    under_none = np.minimum(left, right) > LIMITS.largest_distance
    uncertain = loaded & (under_none | (undecided & standing))
    return Pressure(loaded, distance, (right < left).astype(int), loaded & ~undecided, uncertain)


Foot = Literal["left_foot", "right_foot"]
FEET: Final[tuple[Foot, Foot]] = ("left_foot", "right_foot")


class Contact(NamedTuple):
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


class SharedPlates(NamedTuple):
    """Which foot each plate carries.

    Attributes
    ----------
    on
        0 left and 1 right, (T, P).
    ambiguous
        Frames in which the split of a plate between the feet is uncertain, (T, P).
    contacts
        All contacts in order of plate and time.
    """

    on: Indices
    ambiguous: Mask
    contacts: tuple[Contact, ...]


def feet_of(places: Array) -> Array:
    """Give the middle of the left and right foot, ankle to ball, of `places_of`, (T, 2, 3) [m]."""
    return np.asarray((places[:, 1:3] + places[:, 3:]) / 2)


def both_stand(places: Array, time: Array) -> Mask:
    """Find the frames in which no foot swings, (T,): part of each is at rest against the other."""
    velocity = np.gradient(places[:, 1:], time, axis=0)
    # ankle and ball of the left foot against both of the right one, wherever the ground moves
    apart = velocity[:, [0, 2], None] - velocity[:, None, [1, 3]]
    slowest = np.sqrt(np.square(apart).sum(axis=-1)).min(axis=(1, 2))
    # walking speed differs from trial to trial: a fraction of the fastest swing
    fastest = np.nanquantile(slowest, 0.95) if np.isfinite(slowest).any() else np.nan
    return np.asarray(slowest < max(LIMITS.standing_fraction * fastest, LIMITS.swinging_speed))


def share_between_feet(
    time: Array,
    wrenches: Sequence[Array],
    feet: Array,
    threshold_n: float,
    *,
    standing: Mask | None = None,
    numbers: Sequence[int] | None = None,
    by_hand: Sequence[PlateContact] = (),
    method: Method = "zero_phase",
) -> SharedPlates:
    """Find the foot that stood on each plate.

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
    standing
        Frames in which no foot swings, (T,), as `both_stand` gives them; None if not known.
    numbers
        Of the plates in the file, which may lack some; by default from 1.
    by_hand
        Contacts whose foot a person states; they overrule the centre of pressure.
    method
        With "realtime" the foot of a frame depends on no later one.

    Returns
    -------
    SharedPlates
        Foot of every frame, doubtful frames, contacts; `by_foot` gives the wrenches to the feet.

    Raises
    ------
    ValueError
        If a stated time is not in the recording or has no contact, two statements about a contact
        contradict each other, or there is no such plate.

    Notes
    -----
    A loaded frame belongs to the foot whose middle is nearer to the centre of pressure by 0.1 m at
    least. Within a contact, stretches of one foot that are shorter than 0.1 s do not count beside
    longer ones. Of the frames between two stretches, unloaded or undecided, each half belongs to
    the nearer one's foot. Where both feet bear more than the threshold on one plate, as its
    pressure lies between them, it is uncertain from when the second one stands until one of them
    swings. In real time no stretch is too short, all frames between two belong to the first one's
    foot, and frames alone are doubtful, not whole contacts. Residuals do not depend on this choice,
    joint moments do.
    """
    numbers = numbers or range(1, len(wrenches) + 1)
    require_contacts(by_hand, numbers, time)
    live = method == "realtime"
    contacts, on, ambiguous = list[Contact](), list[Indices](), list[Mask]()
    for number, wrench in zip(numbers, wrenches, strict=True):
        pressure = pressure_beside(wrench, feet, threshold_n, None if live else standing)
        loaded = stretches(pressure.loaded).tolist()
        if not live:
            _drop_brief(pressure, loaded, time)
        _overrule(
            pressure, loaded, time, [contact for contact in by_hand if contact.plate == number]
        )
        on.append(_foot_of_frames(pressure, live))
        of_plate = _contacts(number, pressure, loaded, time, on[-1])
        contacts += of_plate
        uncertain = pressure.uncertain.copy()
        if not live and standing is not None:
            under_both = _bears_both(pressure, feet, wrench[:, 2], threshold_n)
            for start, stop in stretches(pressure.loaded & standing):
                uncertain[start:stop] |= under_both[start:stop].any()
        for contact in () if live else of_plate:
            uncertain[contact.start : contact.stop] |= contact.ambiguous
        ambiguous.append(uncertain)
    return SharedPlates(np.stack(on, axis=1), np.stack(ambiguous, axis=1), tuple(contacts))


def _bears_both(pressure: Pressure, feet: Array, load: Array, threshold_n: float) -> Mask:
    """Find the frames in which a plate bears more than the threshold of either foot, (T,)."""
    # free space between the outlines of both feet
    between = np.linalg.norm(feet[:, 1, :2] - feet[:, 0, :2], axis=1) - 2 * LIMITS.foot_radius
    # the foot farther away bears at least as much as moves the pressure beyond the nearer one
    beyond = np.clip(pressure.distance.min(axis=1) - LIMITS.foot_radius, 0, None)
    return np.asarray(pressure.loaded & (load * beyond > threshold_n * np.maximum(between, 0)))


def by_foot(wrenches: Array, on: Indices) -> Array:
    """Add up the wrenches of the plates, (..., P, 6), under each foot, (..., 2, 6).

    ``on`` is the foot that each plate carries, 0 left and 1 right, (..., P).
    """
    # a plate is added to the foot that it carries, 0 to the other one
    under = (on[..., None, :] == np.arange(2)[:, None])[..., None]
    return np.asarray(np.where(under, wrenches[..., None, :, :], 0.0).sum(axis=-2))


def require_contacts(by_hand: Iterable[PlateContact], numbers: Sequence[int], time: Array) -> None:
    """Refuse stated contacts of a plate, or at a time, that is not there, or of two feet at once.

    Parameters
    ----------
    by_hand
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
    feet: dict[tuple[int, int], PlateContact] = {}
    for contact in by_hand:
        if contact.plate not in numbers:
            raise ValueError(
                f"contacts: there is no plate {contact.plate}; plates are {numbers[0]} to "
                f"{numbers[-1]}"
            )
        if not time[0] <= contact.time_s <= time[-1]:
            raise ValueError(
                f"contacts: {contact.time_s:g} s is not in the recording, which lasts from "
                f"{time[0]:.2f} to {time[-1]:.2f} s"
            )
        frame = int(np.argmin(np.abs(time - contact.time_s)))
        _require_one_foot(feet.setdefault((contact.plate, frame), contact), contact)


def _require_one_foot(before: PlateContact, each: PlateContact) -> None:
    """Refuse two feet for one contact."""
    if before.foot != each.foot:
        raise ValueError(
            f"contacts: plate {each.plate} carries the {before.foot} foot at {before.time_s:g} s "
            f"and the {each.foot} one at {each.time_s:g} s, but that is one contact; give one of "
            "them"
        )


def far_from_feet(shared: SharedPlates) -> tuple[Note, ...]:
    """Name plates with pressure far from both feet."""
    notes = []
    for plate in sorted({contact.plate for contact in shared.contacts}):
        distance_m = float(np.median([c.distance_m for c in shared.contacts if c.plate == plate]))
        if distance_m > LIMITS.far:
            notes.append(Note.of("pressure_far_from_feet", plate=plate, distance_m=distance_m))
    return tuple(notes)


def ambiguous_contacts(shared: SharedPlates, time: Array) -> tuple[Note, ...]:
    """Name contacts that cannot be assigned to a foot."""
    doubtful = [(contact.start, contact.stop) for contact in shared.contacts if contact.ambiguous]
    if not doubtful:
        return ()
    times = _listed(time, doubtful)
    return (Note.of("contacts_ambiguous", contacts=len(doubtful), times=times),)


def _drop_brief(pressure: Pressure, loaded: Sequence[Sequence[int]], time: Array) -> None:
    """Leave brief stretches of one foot undecided beside a longer one of the same contact."""
    for start, stop in loaded:
        decided = start + np.flatnonzero(pressure.decided[start:stop])
        # stretches of frames that belong to one foot without a doubt
        runs = np.split(decided, np.flatnonzero(np.diff(pressure.nearer[decided])) + 1)
        lasting = [np.ptp(time[run]) if len(run) else 0.0 for run in runs]
        if max(lasting) < LIMITS.shortest_stance:
            continue
        for run, duration in zip(runs, lasting, strict=True):
            # a stretch that the recording cuts may have been longer
            cut_off = run[0] == 0 or run[-1] == len(time) - 1
            if duration < LIMITS.shortest_stance and not cut_off:
                pressure.decided[run] = False


def _overrule(
    pressure: Pressure,
    loaded: Sequence[Sequence[int]],
    time: Array,
    by_hand: Sequence[PlateContact],
) -> None:
    """Take the foot of a contact from a person."""
    feet: dict[int, PlateContact] = {}
    for contact in by_hand:
        frame = int(np.argmin(np.abs(time - contact.time_s)))
        inside = [(a, b) for a, b in loaded if a <= frame < b]
        if not inside:
            raise ValueError(
                f"contacts: nobody is on plate {contact.plate} at {contact.time_s:g} s; it is "
                f"loaded: {_listed(time, loaded) or 'never'}"
            )
        start, stop = inside[0]
        if np.mean(pressure.uncertain[start:stop]) <= LIMITS.doubtful_fraction:
            # the part of the contact around this frame in which the foot does not change
            foot = _foot_of_frames(pressure)
            same = stretches(foot == foot[frame]).tolist()
            first, last = next((a, b) for a, b in same if a <= frame < b)
            start, stop = max(start, first), min(stop, last)
        _require_one_foot(feet.setdefault(start, contact), contact)
        pressure.nearer[start:stop] = SIDES.index(contact.foot)
        pressure.decided[start:stop] = True
        pressure.uncertain[start:stop] = False


def _foot_of_frames(pressure: Pressure, live: bool = False) -> Indices:
    """Give the foot that was decided nearest or, in real time, last, 0 left and 1 right, (T,)."""
    frames, decided = np.arange(len(pressure.nearer)), np.flatnonzero(pressure.decided)
    if live:
        # in real time the foot that was decided last goes on
        last = np.maximum.accumulate(np.where(pressure.decided, frames, -1))
        return np.asarray(pressure.nearer[np.where(last < 0, frames, last)])
    # without any decided frame the nearer foot has the load
    if not len(decided):
        return pressure.nearer
    # each half of the frames between two decided ones belongs to the nearer one
    nearest = decided[np.searchsorted((decided[1:] + decided[:-1]) / 2, frames)]
    return np.asarray(pressure.nearer[nearest])


def _contacts(
    number: int, pressure: Pressure, loaded: Sequence[Sequence[int]], time: Array, on: Indices
) -> list[Contact]:
    """List the contacts of a plate with their feet."""
    contacts, nearest = list[Contact](), pressure.distance.min(axis=1)
    for start, stop in loaded:
        if time[stop - 1] - time[start] < LIMITS.shortest_stance:
            continue
        # first frame of each foot within the contact
        first = start + np.flatnonzero(np.diff(on[start:stop], prepend=-1))
        feet, changes = tuple(FEET[k] for k in on[first]), tuple(first[1:].tolist())
        doubtful = bool(np.mean(pressure.uncertain[start:stop]) > LIMITS.doubtful_fraction)
        nearest_m = median_of(nearest[start:stop])
        contacts.append(Contact(number, start, stop, feet, doubtful, nearest_m, changes))
    return contacts


def _listed(time: Array, stretches: Sequence[Sequence[int]]) -> str:
    """Name the times of stretches, the first ones of many."""
    # eight fill a line of a note; the frames of all are marked
    named = [f"{time[a]:.2f}–{time[b - 1]:.2f} s" for a, b in stretches[:8]]
    more = ["…"] if len(stretches) > 8 else []
    return ", ".join([*named, *more])
