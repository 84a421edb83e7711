"""What people are told of a trial: the notes of its stages, each made once, in order."""

from collections.abc import Iterator, Sequence

from hbm.notes import Note
from hbm.plausibility.motion import implausible
from pipeline.trial.chain import Chain
from pipeline.trial.checks import check_motion, other_person, plates_apart
from pipeline.trial.corrections import finding_of
from pipeline.trial.findings.finding import Finding
from pipeline.trial.findings.judge import Fitted, instead_of_mass
from pipeline.trial.findings.words import note_of
from pipeline.trial.gait.contact import ambiguous_contacts, far_from_feet
from pipeline.trial.ground.wrenches import uncertainty_notes
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
    of_motion, misfits = check_motion(body, chain.pose.solved, chain.pose.markers)
    loads, ground = chain.loads, chain.ground
    support, in_part = carried_notes(chain.quality, time, loads.need, loads.measured)
    yield from trial.notes
    of_load = [finding for finding in faults if finding.of_load]
    named = {number for finding in of_load for number in finding.plates}
    yield from (fact.note for k, fact in reversed_plates(trial).items() if k not in named)
    yield mass.note
    yield from implausible(body)
    yield from chain.labels.notes
    yield from body.notes
    yield from chain.solved.outliers
    yield from of_motion
    if not other:  # who stood in another person's place explains these
        yield from (*chain.labels.distances, *misfits)
    yield from ground.notes
    yield from chain.moves
    yield from plates_apart(trial)
    if chain.uncertainty is not None:
        yield from uncertainty_notes(chain.uncertainty[chain.counts])
    yield from support
    yield from ambiguous_contacts(loads.shared, time)
    if not of_load:
        yield from (*far_from_feet(loads.shared), *in_part)
    yield from _of_delay(chain)
    yield from (note_of(finding, trial.plates, time) for finding in faults)
    drifts = any(finding.kind == "drift" for finding in of_load)
    if chain.carried_kg is not None and not drifts:
        yield Note.of("mass_carried", mass_kg=chain.carried_kg)
    if not other:
        yield from _of_masses(chain, None if of_load else chain.carried_kg)
    yield from chain.gait.doubts
    yield from chain.window.notes


def _of_delay(chain: Chain) -> Iterator[Note]:
    """Say how much later the plates are than the markers, as the whole body's motion shows it."""
    late = chain.delay
    if late.why_unknown:
        yield Note.of("plate_delay_unknown", reason=late.why_unknown)
    else:
        yield Note.of("plate_delay", delay_s=late.seconds, uncertainty_s=late.uncertainty_s)


def _of_masses(chain: Chain, carried_kg: float | None) -> Iterator[Note]:
    """Say that masses differ; with the faults of plates that this may be instead."""
    masses = differing_masses(chain.mass.known_kg, carried_kg)
    places = chain.ground.plates
    instead: tuple[Fitted, ...] = ()
    if masses and carried_kg is not None and chain.stands_still:
        instead = instead_of_mass(chain.evidence, mass_is_stated=chain.mass.is_stated)
    faults = [str(note_of(finding_of(fault, places), places, chain.time)) for fault in instead]
    for note in masses:
        both = "; or ".join([str(note), *faults])
        yield Note.of("plates_unclear", faults=both) if faults else note
