"""What people are told of a trial: the notes of its stages, each made once, in order."""

from collections.abc import Iterator, Mapping, Sequence
from typing import Final

import numpy as np

from hbm.notes import Note
from hbm.plausibility.motion import implausible
from pipeline.io.recording import Plate
from pipeline.io.stated import correction
from pipeline.trial.chain import Chain
from pipeline.trial.checks import check_motion, check_plates, other_person
from pipeline.trial.corrections import finding_of, try_mendings
from pipeline.trial.findings.finding import Correction, Finding
from pipeline.trial.findings.judge import Fitted, instead_of_mass
from pipeline.trial.findings.raw import RawFault
from pipeline.trial.gait.contact import ambiguous_contacts, far_from_feet
from pipeline.trial.ground.uncertainty import uncertainty_notes
from pipeline.trial.plate_units import reversed_plates
from pipeline.trial.quality import carried_notes
from pipeline.trial.subject import ON_PLATES, differing_masses


def notes_of(chain: Chain, faults: Sequence[Finding]) -> tuple[Note, ...]:
    """Make the notes of a trial, with the faults of its plates."""
    return tuple(_notes(chain, faults))


def _notes(chain: Chain, faults: Sequence[Finding]) -> Iterator[Note]:
    """Give what was read, then what each stage found, in the order of the method."""
    trial, body, mass, time = chain.trial, chain.body, chain.mass, chain.time
    carried = {ON_PLATES: chain.carried_kg} if chain.carried_kg else {}
    known_kg = {**mass.known_kg, **carried}
    other = chain.inputs.static and other_person(body, trial, chain.standing, known_kg)
    if other:
        yield other
    motion = check_motion(body, chain.pose.solved, chain.pose.markers)
    loads, ground = chain.loads, chain.ground
    support = carried_notes(chain.quality, time, loads.need, loads.measured)
    yield from trial.notes
    named = {number for finding in faults for number in finding.plates}
    named |= {fault.plate for fault in chain.raw_faults}
    yield from (fact.note for k, fact in reversed_plates(trial).items() if k not in named)
    yield mass.note
    yield from implausible(body)
    yield from chain.labels.notes
    yield from body.notes
    yield from chain.solved.outliers
    yield from motion.notes
    if not other:  # who stood in another person's place explains these
        yield from (*chain.labels.distances, *motion.misfits)
    yield from ground.notes
    yield from chain.moves
    zeros, others = check_plates(trial, ground.variants[ground.best], mass.mass_kg)
    if zeros is not None:
        remedy = _remedy(try_mendings(chain, zeros.mendings) if zeros.mendings else None)
        yield zeros.note(remedy, mass.mass_kg)
    yield from others
    if chain.uncertainty is not None:
        yield from uncertainty_notes(chain.uncertainty[chain.counts])
    yield from support.notes
    yield from ambiguous_contacts(loads.shared, time)
    if not (faults or chain.raw_faults):
        yield from (*far_from_feet(loads.shared), *support.doubtful)
    yield from _of_delay(chain)
    for number in dict.fromkeys(fault.plate for fault in chain.raw_faults):
        yield from _of_raw(chain, [f for f in chain.raw_faults if f.plate == number])
    yield from _of_faults(faults, ground.plates)
    if chain.carried_kg is not None:
        yield Note.of("mass_carried", mass_kg=chain.carried_kg)
    if not other:
        yield from _of_masses(chain)
    yield from chain.gait.doubts
    yield from chain.window.notes


def _of_delay(chain: Chain) -> Iterator[Note]:
    """Say how much later the plates are than the markers, as the whole body's motion shows it."""
    late = chain.delay
    if late.why_unknown:
        yield Note.of("plate_delay_unknown", reason=late.why_unknown)
    else:
        yield Note.of("plate_delay", delay_s=late.seconds, uncertainty_s=late.uncertainty_s)


AXES: Final = ("forward", "sideways", "vertical")
CHANNELS_OF: Final = "force", "moment"
NO_CORRECTION: Final = "No correction that can be typed makes the residual smaller."


def _of_masses(chain: Chain) -> Iterator[Note]:
    """Say that masses differ; with the faults of plates that this may be instead."""
    masses = differing_masses(chain.mass.known_kg, chain.carried_kg)
    places = {plate.number: plate for plate in chain.ground.plates}
    weak: tuple[Fitted, ...] = ()
    if masses and chain.carried_kg is not None and chain.stands_still:
        weak = instead_of_mass(chain.evidence, mass_is_stated=chain.mass.is_stated)
    gains = [str(_of_fault(finding_of(each, chain.ground.plates), places)) for each in weak]
    for note in masses:
        yield Note.of("plates_unclear", faults="; or ".join([str(note), *gains])) if gains else note


def _of_raw(chain: Chain, faults: Sequence[RawFault]) -> Iterator[Note]:
    """Name the channels of a plate by what their raw samples show."""
    plate = faults[0].plate
    for kind in dict.fromkeys(fault.kind for fault in faults):
        same = [fault for fault in faults if fault.kind == kind]
        sizes = {fault.channel: abs(fault.size) for fault in same}
        first_s, count = min(f.first_s for f in same), sum(f.count for f in same)
        match kind:
            case "dead":
                yield Note.of("plate_dead", plate=plate, channels=[*sizes])
            case "clipped":
                spans = np.array([span for fault in same for span in fault.spans_s])
                inside = (spans[:, :1] <= chain.time) & (chain.time <= spans[:, 1:])
                frames = int(np.count_nonzero(inside.any(axis=0)))
                at = {"frames": frames, "first_s": first_s}
                yield Note.of("plate_clipped", plate=plate, limits=sizes, **at)
            case "wraps":
                remedy = _remedy(try_mendings(chain, [f"{plate}: unwrap {n}" for n in sizes]))
                at = {"jumps": count, "first_s": first_s}
                yield Note.of("plate_wraps", plate=plate, sizes=sizes, **at, remedy=remedy)
            case "jumps":
                at = {"jumps": count, "first_s": first_s}
                yield Note.of("plate_jumps", plate=plate, sizes=sizes, **at)


def _of_faults(faults: Sequence[Finding], places: Sequence[Plate]) -> Iterator[Note]:
    """Name what is wrong with the plates; what cannot be told apart together."""
    plates = {plate.number: plate for plate in places}
    for finding in faults:
        if finding.rivals:
            each = [str(_of_fault(rival, plates)) for rival in (finding, *finding.rivals)]
            yield Note.of("plates_unclear", faults="; or ".join(each))
        else:
            yield _of_fault(finding, plates)


def _of_fault(finding: Finding, plates: Mapping[int, Plate]) -> Note:
    """Put a fault of plates in words."""
    number, size, interval = finding.plates[0], np.array(finding.size), finding.interval
    remedy = _remedy(finding.correction)
    match finding.kind:
        case "gain":
            # what corrects it is a factor; what is measured is its inverse
            bounds = 1 / (1 + size[0] + np.array([1.0, -1.0]) * interval[0])
            low, high = sorted(bounds.tolist())
            axis = int(
                np.argmax(np.abs(plates[number].rotation[:, "xyz".index(finding.component[1])]))
            )
            direction = f"{AXES[axis]} {CHANNELS_OF[finding.component[0] == 'M']}"
            values = {"component": finding.component, "direction": direction, "remedy": remedy}
            share = 1 / (1 + size[0])
            return Note.of("plate_gain", plate=number, share=share, low=low, high=high, **values)
        case "reversed":
            return Note.of("plate_reversed", plate=number, what=finding.component, remedy=remedy)
        case "turned":
            return Note.of("plate_turned", plate=number, what=finding.component, remedy=remedy)
        case "exchanged":
            first, second = finding.plates
            return Note.of("plates_exchanged", first=first, second=second, remedy=remedy)
        case "moved":
            forward, left, _ = plates[number].rotation @ -np.array([*size, 0.0])
            off_m = {"forward": forward, "left": left}
            return Note.of(
                "plate_elsewhere",
                plate=number,
                off_m=off_m,
                interval_m=max(interval),
                remedy=remedy,
            )
        case "askew":
            turn_deg, interval_deg = -np.degrees(size[0]), np.degrees(interval[0])
            return Note.of(
                "plate_askew", plate=number, turn_deg=turn_deg, interval_deg=interval_deg
            )
        case "late":
            return Note.of("plate_late", plate=number, delay_s=size[0], interval_s=interval[0])
    return Note.of("plates_late", delay_s=size[0], uncertainty_s=interval[0], remedy=remedy)


def _remedy(tried: Correction | None) -> str:
    """Say what to type, and what it does; nothing is to be typed that does not help."""
    if tried is None or not tried.helps:
        return NO_CORRECTION
    if tried.plate_delay_s is not None:
        delay = f"plate_delay_s = {tried.plate_delay_s:.3f}"
        option = f"--plate-delay-ms {1000 * tried.plate_delay_s:.0f}"
        return f"Set {delay} ({option}): {tried.effect}."
    return f"Set {correction(*tried.mendings)}: {tried.effect}."
