"""What may be wrong with the body: masses, joints, and soft tissue that markers do not show.

Part of a segment's mass hangs on springs and dampers from its bone, whose acceleration drives it:
an oscillator in axes of the lab. The plates measure its force. The oscillators are linear, and
filters too: those that the filtered motion drives give the filtered force.
"""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import Final

import numpy as np

from hbm.body import FEET, shoe_inertia
from hbm.coordinates import FIXED_TO, MOVING, PARENT, SIDES, UP
from hbm.ik.tracking import solve_ik
from hbm.model import Body
from hbm.numbers import read_numbers
from hbm.plausibility.motion import TRUNK
from hbm.poses import segment_frames
from hbm.segments import NO_INERTIA, Inertia
from hbm.signals.filtering import oscillation
from hbm.spatial import GRAVITY_MPS2, Array, rotation_about
from pipeline.explain.cause import Altered, Cause, Prior, change_of, priors
from pipeline.explain.causes.plates import with_added
from pipeline.trial.chain import Chain, needed_wrench

LIMITS: Final = read_numbers("pipeline.explain", "thresholds.toml", "body")
LONG_BONES: Final = ("thigh", "shank")
"""Segments whose inertia lies between two joint centres that may be wrong."""

PARTS: Final[Mapping[str, tuple[tuple[str, ...], str, str]]] = {
    "pelvis": (("pelvis",), "pelvis_mass", "xyz"),
    "trunk": (TRUNK, "trunk_mass", "xyz"),
    "head": (("head",), "trunk_mass", "xy"),
    "thighs": (("thigh",), "thigh_mass", "xyz"),
    "shanks": (("shank",), "limb_mass", "xyz"),
    "feet": (("foot",), "foot_mass", "xyz"),
    "arms": (("upper_arm", "forearm", "hand"), "limb_mass", "x"),
}
"""Part of the body -> its segments, limbs without their side; what is known of its mass; and the
axes along which its centre of mass matters: more than 0.3 N or 0.1 N·m in a recording of walking,
as for all causes here. The segments of a part move almost together and cannot be distinguished."""

LEAST_MASS: Final = 0.1
"""Of a segment's own, which a size drawn at random may undercut."""

AXES: Final = dict(zip("xyz", np.eye(3), strict=True))
JOINTS: Final = {"hip": "thigh", "knee": "shank", "ankle": "foot"}
"""Joint of a leg -> the segment that it carries."""


def body_causes(chain: Chain) -> Iterator[Cause]:
    """Give what may be wrong with the body of a trial.

    Yields
    ------
    Cause
        The mass of the body; of each part, limbs in pairs, the share of that mass and the centre;
        radii of gyration of thighs and shanks; the mass of a shoe that the body lacks on each foot,
        its total mass being right; centres of the joints of the legs and of the lumbar
        joint; and directions of the knees' axes in the horizontal plane. Joints move the segments
        too: markers keep their places, and the inverse kinematics finds other coordinates. Sizes
        say by how much the body that is used is wrong.
    """
    prior_of, inertias = priors(), chain.body.segments
    heavier = change_of("body", partial(_with_share, names=tuple(inertias)))
    yield Cause("body mass", "inertia", prior_of["body_mass"], heavier)
    for part, (segments, kind, axes) in PARTS.items():
        of_sides = {f"{side}_{segment}" for side in SIDES for segment in segments}
        names = tuple(name for name in inertias if name in of_sides.union(segments))
        heavier = change_of("body", partial(_with_share, names=names))
        yield Cause(f"{part}: mass", "inertia", prior_of[kind], heavier)
        for letter in axes:
            is_limb = len(names) > len(segments)
            prior = prior_of["limb_center" if is_limb else f"trunk_center_{letter}"]
            moved = change_of("body", partial(_with_center, names=names, by=AXES[letter]))
            yield Cause(f"{part}: centre of mass along {letter}", "inertia", prior, moved)
        if segments[0] in LONG_BONES:
            wider = change_of("body", partial(_with_gyration, names=names))
            yield Cause(f"{part}: radii of gyration", "inertia", prior_of["gyration"], wider)
    # children wear lighter shoes than adults, for whom the usual size is
    shoe = prior_of["stated_shoe_mass" if chain.shoes_are_known else "shoe_mass"]
    shoe = replace(shoe, size=min(shoe.size, LIMITS.largest_shoe * inertias[FEET[0]].mass))
    yield Cause("shoes: missing mass", "shoes", shoe, change_of("body", _without_shoes))
    joints = {f"{s} {joint}": f"{s}_{segment}" for joint, segment in JOINTS.items() for s in SIDES}
    for name, segment in {**joints, "lumbar joint": "thorax"}.items():
        prior = prior_of[f"{name.removesuffix(' joint').split()[-1]}_center"]
        for letter, axis in AXES.items():
            altered = partial(_with_joint, segment=segment, by=axis)
            yield _of_geometry(chain, f"{name}: centre along {letter}", prior, altered)
    for side, letter in SIDES.items():
        altered = partial(_with_axis, coordinate=f"{letter}KneeFlexion")
        yield _of_geometry(chain, f"{side} knee: axis about z", prior_of["knee_axis"], altered)


def _with_segments(body: Body, segments: Mapping[str, Inertia]) -> Body:
    """Give the body with some segments of other inertia."""
    inertias = {**body.segments, **segments}
    return replace(body, segments=inertias, mass=sum(part.mass for part in inertias.values()))


def _with_share(body: Body, share: float, *, names: Sequence[str]) -> Body:
    """Make segments heavier by a share and the others, if any, lighter, so that the mass stays.

    What asks for almost no mass or less, leaves a little.
    """
    mass = sum(body.segments[name].mass for name in names)
    rest = sum(part.mass for part in body.segments.values()) - mass
    scaled = {}
    for name, part in body.segments.items():
        # the same shape with another density: the tensor changes with the mass
        factor = max(1 + share if name in names else 1 - share * mass / rest, LEAST_MASS)
        scaled[name] = Inertia(factor * part.mass, part.center, factor * part.tensor)
    return _with_segments(body, scaled)


def _without_shoes(body: Body, mass_kg: float) -> Body:
    """Take a shoe of a mass off each foot, and make all else heavier, so that the mass stays."""
    feet = {}
    for foot in FEET:
        taken_kg = min(mass_kg, (1 - LEAST_MASS) * body.segments[foot].mass)
        # a negative mass puts a shoe on
        ball, length = body.offsets[foot.replace("foot", "toes")], body.lengths[foot]
        shoe = shoe_inertia(ball, length, abs(taken_kg), 0.0)
        feet[foot] = body.segments[foot] - shoe if taken_kg > 0 else body.segments[foot] + shoe
    bare = _with_segments(body, feet)
    return _with_share(bare, body.mass / bare.mass - 1, names=tuple(bare.segments))


def _with_center(body: Body, distance: float, *, names: Sequence[str], by: Array) -> Body:
    """Move centres of mass along an axis of their segments [m]; on the left, its mirror image."""
    segments = dict(body.segments)
    for name in names:
        mirrored = (1, -1, 1) if name.startswith("left") else (1, 1, 1)
        _shift(segments, name, distance * by * mirrored)
    return _with_segments(body, segments)


def _with_gyration(body: Body, share: float, *, names: Sequence[str]) -> Body:
    """Make radii of gyration larger by a share."""
    # moments of inertia are those of masses at the radius of gyration: I = m k²
    parts, factor = body.segments, (1 + share) ** 2
    wider = {name: replace(parts[name], tensor=factor * parts[name].tensor) for name in names}
    return _with_segments(body, wider)


def _of_geometry(chain: Chain, name: str, prior: Prior, altered: Altered) -> Cause:
    """Give a cause that alters joints of the body, and so what the inverse kinematics finds.

    Coordinates change in proportion to its size: as they do for a small one, found from those of
    the chain. Sizes agree with those from other starts to 1e-8 of their deviations.
    """
    # a tenth of a deviation: squares of it do not matter, and rounding is far below it
    small = 0.1 * prior.size
    q = solve_ik(altered(chain.body, small), chain.markers, near=chain.q).q
    follow = np.where(np.isnan(chain.q), np.nan, np.nan_to_num((q - chain.q) / small))

    def change(of: Chain, size: float) -> Chain:
        return of.changed(body=altered(of.body, size), q=of.q + size * follow)

    moves = np.ones((len(follow), 1)), follow
    return Cause(name, "markers", prior, change, moves=moves, alters=altered)


def _with_joint(body: Body, distance: float, *, segment: str, by: Array) -> Body:
    """Move a segment's proximal joint, by a vector in axes of its parent times a size [m].

    Axes of parent and segment are taken as parallel: they are in the neutral pose, and almost in
    the calibration pose that showed the joint. Markers and the other joints stay where they are.
    Centres of mass of thighs and shanks keep their share of the way between the joints, those of
    the other segments stay where they are.
    """
    step = distance * by
    offsets = dict(body.offsets)
    # the segment's own joint moves in its parent; those distal to it stay where they are in the lab
    for other, parent in PARENT.items():
        if other == segment:
            offsets[other] = offsets[other] + step
        elif parent == segment:
            offsets[other] = offsets[other] - step
    # the segment's axes begin at the joint: what is fixed in it moves by as much the other way
    is_carried = np.array([segment == carrier for carrier in body.marker_segment])
    markers = body.marker_position - is_carried[:, None] * step
    segments = dict(body.segments)
    _shift(segments, segment, -_share_of_way(body, segment, otherwise=1.0) * step)
    for name, carrier in FIXED_TO.items():
        if carrier == segment:
            _shift(segments, name, -step)
    # the joint is the distal end of the parent, whose centre of mass follows in proportion
    parent = PARENT[segment]
    _shift(segments, parent, _share_of_way(body, parent, otherwise=0.0) * step)
    return replace(body, offsets=offsets, marker_position=markers, segments=segments)


def _with_axis(body: Body, angle: float, *, coordinate: str) -> Body:
    """Turn the axis of a hinge about the vertical axis of its parent [rad]."""
    turned = rotation_about(np.array(UP), angle) @ body.axes[coordinate]
    return replace(body, axes={**body.axes, coordinate: turned})


def _share_of_way(body: Body, segment: str, otherwise: float) -> float:
    """Give how far along a long bone its centre of mass is, 0 to 1; what is stated for others."""
    if not segment.endswith(LONG_BONES):
        return otherwise
    distal = next(body.offsets[s] for s, parent in PARENT.items() if parent == segment)
    # projection of the centre of mass on the line between the joints
    return float(body.segments[segment].center @ distal / (distal @ distal))


def _shift(segments: dict[str, Inertia], name: str, by: Array) -> None:
    segments[name] = replace(segments[name], center=segments[name].center + by)


@dataclass(frozen=True, slots=True)
class Tissue:
    """Soft tissue of a segment.

    Attributes
    ----------
    share
        Its mass, of that of the segment [1].
    frequency_hz, damping
        Natural frequency and damping ratio of its oscillation.
    """

    share: float
    frequency_hz: float
    damping: float


TISSUES: Final[Mapping[str, Mapping[str, Tissue]]] = {
    "pelvis": {"pelvis": Tissue(0.5, 4.5, 0.5)},
    "trunk": dict.fromkeys(("mid_trunk", "thorax"), Tissue(0.5, 4.5, 0.5)),
    "legs": {
        **{f"{side}_thigh": Tissue(0.6, 9.0, 0.5) for side in SIDES},
        **{f"{side}_shank": Tissue(0.6, 12.0, 0.5) for side in SIDES},
    },
}
"""Part of the body -> its segments and their tissue. The masses on springs of Liu and Nigg (2000, J
Biomech 33:219) are 50 of 63 kg of the upper body and 6 of 12 kg of a leg; their springs and dampers
give 3.8 and 8.2 Hz and damping ratios of 0.8 and 1.0. Standing people are in resonance at 5 to 6 Hz
(Matsumoto and Griffin 1998, J Sound Vib 212:85); muscles of the leg vibrate at 10 Hz and more,
shank above thigh, damped the more the more active they are (Wakeling and Nigg 2001, J Appl Physiol
90:412). Of the trunk, the viscera are an eighth of the body's mass at least (9 kg: Minetti and
Belli 1994, J Biomech 27:97). The numbers lie between these; damping below that of the running model
is assumed for walking, as resonances of standing people are seen at all."""


def soft_tissue_causes(chain: Chain) -> Iterator[Cause]:
    """Give what soft tissue does to a trial.

    Yields
    ------
    Cause
        Of pelvis, trunk and legs, vertically and horizontally: the mass of soft tissue, as a
        multiple of the published one, which is therefore about one and not zero; and by which share
        its frequency and damping differ from the published ones, to first order.
    """
    prior_of, step = priors(), 0.1
    more, less = 1 + step, 1 - step
    directions = {"vertical": np.diag([0.0, 0.0, 1.0]), "horizontal": np.diag([1.0, 1.0, 0.0])}
    for part, tissues in TISSUES.items():
        courses = [(tissue, *_course(chain, name)) for name, tissue in tissues.items()]
        for direction, along in directions.items():
            # mass is linear; frequency and damping are not, so central differences
            total = partial(_tissue_wrench, courses, chain.time, along)
            wrenches = {
                "mass": total(),
                "frequency": (total(stiffer=more) - total(stiffer=less)) / (2 * step),
                "damping": (total(damped=more) - total(damped=less)) / (2 * step),
            }
            for kind, wrench in wrenches.items():
                change = change_of("soft_tissue", partial(with_added, wrench=wrench))
                name = f"soft tissue of {part}: {kind} of {direction} motion"
                yield Cause(name, "soft_tissue", prior_of[f"tissue_{kind}"], change)


def _tissue_wrench(
    courses: Sequence[tuple[Tissue, float, Array, Array]],
    time: Array,
    along: Array,
    *,
    stiffer: float = 1.0,
    damped: float = 1.0,
) -> Array:
    """Give what tissues of segments add together, frequencies and damping times a factor."""
    wrench = np.zeros((len(time), 6))
    for tissue, mass_kg, place, pull in courses:
        oscillator = tissue.frequency_hz * stiffer, tissue.damping * damped
        kilogram = oscillator_wrench(*oscillator, time, place, pull, along)
        wrench += tissue.share * mass_kg * kilogram
    return wrench


def oscillator_wrench(
    frequency_hz: float, damping: float, time: Array, place: Array, pull: Array, along: Array
) -> Array:
    """Give what a kilogram on springs and dampers adds to the wrench on the ground by moving.

    Parameters
    ----------
    frequency_hz, damping
        Natural frequency and damping ratio.
    time
        (T,) [s].
    place
        Where it would be without springs, (T, 3) [m].
    pull
        Its acceleration there less that of gravity, (T, 3) [m/s²].
    along
        Projection on the directions in which it can move, (3, 3).

    Returns
    -------
    Array
        Lab axes about the lab origin, (T, 6) [N, N·m].

    Notes
    -----
    `hbm.signals.filtering.oscillation` gives ``d``. It adds ``m d̈``, and what it needs acts ``d``
    beside its place.
    """
    # in axes of its anchor the mass is driven by minus the anchor's acceleration
    drive = -(pull - [0, 0, GRAVITY_MPS2]) @ along
    frames = np.arange(len(drive))
    # an oscillator needs its drive throughout; in gaps the residual is unknown anyway
    for column in drive.T:
        is_known = np.isfinite(column)
        column[:] = np.interp(frames, frames[is_known], column[is_known])
    # from rest, in equilibrium with the first frame
    drive -= drive[0]
    # about the lab origin: its force at its place, and all that it needs at its displacement

    shift, force = oscillation(drive, time, frequency_hz, damping)
    return np.hstack([force, np.cross(place, force) + np.cross(shift, pull + force)])


def _course(chain: Chain, segment: str) -> tuple[float, Array, Array]:
    """Give mass [kg], course (T, 3) [m] and pull (T, 3) [m/s²] of a segment's centre of mass."""
    inertia = chain.body.segments[segment]
    k = MOVING.index(FIXED_TO.get(segment, segment))
    rotation, origin = segment_frames(chain.body, chain.filtered.value)
    # the wrench of a point mass of 1 kg there has its acceleration less gravity as force
    unit = Inertia(1.0, inertia.center, np.zeros((3, 3)))
    only = {name: unit if name == segment else NO_INERTIA for name in chain.body.segments}
    needed = needed_wrench(replace(chain.body, segments=only), chain.filtered)
    return inertia.mass, origin[:, k] + rotation[:, k] @ inertia.center, needed[:, :3]
