"""Virtual subjects: stature, mass and sex, an individual body, and an individual gait.

People differ from the Human Body Model. Joint centres are known to a centimetre at best: hip
centres by regression err by 8 mm in every direction (Sangeux et al. 2011, Gait Posture 34:324;
2014, 40:20), palpated joint axes by some degrees (Della Croce et al. 2005, Gait Posture 21:226).
Segment masses, centres and radii of gyration differ between methods and people by several per cent
of their values (Rao et al. 2006, J Biomech 39:1531; Dumas et al. 2007, J Biomech 40:543).
"""

from collections.abc import Mapping
from dataclasses import dataclass, fields, replace
from functools import cache
from math import dist
from pathlib import Path
from typing import Final, Literal, NamedTuple

import numpy as np
import pandas as pd

from hbm.coordinates import COORDINATES, INDEX, N_Q
from hbm.markers import marker_sets
from hbm.numbers import read_numbers
from hbm.segments import Inertia, Sex
from hbm.spatial import Array, axes_from, rotation_about
from pipeline.virtual_lab.faults import BodyFaults, Faults
from pipeline.virtual_lab.person import body
from pipeline.virtual_lab.person.anatomy import (
    SIDES,
    Anatomy,
    Proportions,
    axes_of,
    locate,
    offsets_of,
    t_pose,
)
from pipeline.virtual_lab.person.gait import STEP_M, Sole, StepParameters, size_of, sole_of

BODIES: Final = read_numbers("pipeline.virtual_lab.person", "parameters.toml", "bodies")
SHOE: Final = read_numbers("pipeline.virtual_lab.person", "parameters.toml", "shoe")
JOINTS: Final = read_numbers("pipeline.virtual_lab.person", "parameters.toml", "joints")
TISSUE: Final = read_numbers("pipeline.virtual_lab.person", "parameters.toml", "tissue")
STYLE: Final = read_numbers("pipeline.virtual_lab.person", "parameters.toml", "style")

Source = Literal["de_leva", "dumas"]
PAIRED: Final = ("upper_arm", "forearm", "hand", "thigh", "shank", "foot")


class Row(NamedTuple):
    """A segment of a table: fractions of body mass and of the segment's length.

    Attributes
    ----------
    mass
        Fraction of body mass; those of a whole body add up to one.
    center
        Centre of mass: forward, along the segment, to the right, (3,).
    tensor
        Tensor of inertia about it by mass and length squared, in these axes, (3, 3).
    length
        Mean length by stature; NaN where it is not used.
    """

    mass: float
    center: Array
    tensor: Array
    length: float


@cache
def table(source: Source, sex: Sex) -> dict[str, Row]:
    """Give a table's rows for a sex.

    Parameters
    ----------
    source
        "de_leva" or "dumas" (see ``segment_inertias.csv``).
    sex
        Of the person.

    Returns
    -------
    dict of str to Row
        By segment, without side.
    """
    path = Path(__file__).with_name("segment_inertias.csv")
    rows = pd.read_csv(path, comment="#", dtype=str)  # numbers are then read exactly
    rows = rows[(rows["source"] == source) & (rows["sex"] == sex)].set_index("segment")
    # the masses of a published table do not quite add up to the whole body
    total = sum(float(row["mass"]) * (2 if name in PAIRED else 1) for name, row in rows.iterrows())
    return {
        str(name): Row(
            float(row["mass"]) / total,
            row[["center_x", "center_y", "center_z"]].to_numpy(float) / 100,
            _tensor(*(row[["xx", "yy", "zz", "xy", "xz", "yz"]].to_numpy(float) / 100)),
            float(row["length_mm"]) / 1000 / BODIES.mean_stature[source][sex],
        )
        for name, row in rows.iterrows()
    }


def navel_share(sex: Sex) -> float:
    """Give the way from xiphoid to navel as a share of that to mid-hip (de Leva 1996)."""
    rows = table("de_leva", sex)
    middle, lower = rows["mid_trunk"].length, rows["pelvis"].length
    return middle / (middle + lower)


def inertias_of(
    anatomy: Anatomy, source: Source, mass_kg: float, sex: Sex, height_m: float
) -> dict[str, Inertia]:
    """Scale a table to a person.

    Parameters
    ----------
    anatomy
        The person in the T-pose.
    source
        Which table.
    mass_kg, sex, height_m
        Of the person [kg, m].

    Returns
    -------
    dict of str to Inertia
        In the frames of the segments; the toes are massless but for rounding.
    """
    rows, inertias = table(source, sex), dict[str, Inertia]()
    for segment, rotation in anatomy.rotations.items():
        name = segment.removeprefix("right_").removeprefix("left_")
        if name in rows:
            placed = _de_leva(anatomy, segment)
            if source == "dumas":
                placed = _dumas(anatomy, segment, rows["pelvis"].length * height_m)
            part = _scaled(rows[name], mass_kg, *placed)
            inertias[segment] = part.in_frame(rotation, anatomy.origin(segment))
    # the tables' feet include the toes, which take their little mass from them
    for side in SIDES:
        foot = inertias[f"{side}_foot"]
        inertias[f"{side}_foot"] = replace(foot, mass=foot.mass - BODIES.toes_mass)
        tensor = BODIES.toes_mass * BODIES.toes_gyration**2 * np.eye(3)
        inertias[f"{side}_toes"] = Inertia(BODIES.toes_mass, np.zeros(3), tensor)
    return inertias


Placed = tuple[Array, Array, float, str]
"""Origin of a table's segment, (3,) [m]; its frame, (3, 3); its length [m]; and on which side its
third axis, which points outward, is."""


def _de_leva(anatomy: Anatomy, segment: str) -> Placed:
    proximal, distal, lateral = anatomy.ends[segment]
    frame = axes_from(lateral, proximal - distal, exact="up")
    return proximal, frame, dist(distal, proximal), "right"


def _dumas(anatomy: Anatomy, segment: str, pelvis_m: float) -> Placed:
    """Place a segment between its joints: the trunk's are C7/T1, T12/L1 and L5/S1."""
    points, side = anatomy.points, segment.partition("_")[0]
    if segment == "pelvis":
        return points["lumbar"], anatomy.rotations["pelvis"], pelvis_m, "right"
    # the foot's frame: along from heel to tip, left as near to the ankle's axis as that allows
    if segment.endswith("foot"):
        heel, tip, lateral = anatomy.ends[segment]
        origin, ahead = points[f"{side}_ankle"], tip - heel
        left = axes_from(lateral, np.cross(ahead, lateral), exact="up")[:, 1]
        frame = axes_from(left, np.cross(ahead, left), exact="up")
        return origin, frame, dist(points[f"{side}_toes"], origin), side
    if side in SIDES:
        _, distal, lateral = anatomy.ends[segment]
        origin = anatomy.origin(segment)
        frame = axes_from(lateral, origin - distal, exact="up")
        return origin, frame, dist(distal, origin), side
    upper, lower = {
        "head": (points["vertex"], points["neck"]),
        "thorax": (points["neck"], points["mid_trunk"]),
        "mid_trunk": (points["mid_trunk"], points["lumbar"]),
    }[segment]
    frame = axes_from(anatomy.rotations[segment][:, 1], upper - lower, exact="up")
    origin = lower if segment == "head" else upper
    return origin, frame, dist(upper, lower), "right"


def _scaled(
    row: Row, mass_kg: float, origin: Array, frame: Array, length: float, side: str
) -> Inertia:
    """Scale a row to a segment; ``frame`` has the columns forward, left, up of the segment."""
    # the tables' axes: forward, along the segment, outward
    ahead, left, up = frame.T
    outward = left if side == "left" else -left
    axes = np.column_stack([ahead, up, outward])
    mass = row.mass * mass_kg
    return Inertia(
        mass, origin + length * axes @ row.center, mass * length**2 * axes @ row.tensor @ axes.T
    )


def _tensor(xx: float, yy: float, zz: float, xy: float, xz: float, yz: float) -> Array:
    # radii of gyration, whose sign is that of the product of inertia
    radii = np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])
    return np.asarray(np.sign(radii) * radii**2)


def drawn(rng: np.random.Generator, count: int = 1) -> Array:
    """Draw from the standard normal distribution, extremes at two standard deviations, (count,)."""
    most = BODIES.largest_deviation
    return np.asarray(np.clip(rng.normal(size=count), -most, most))


def vary(anatomy: Anatomy, faults: BodyFaults, rng: np.random.Generator) -> Anatomy:
    """Give a person whose joints differ from those that the markers suggest.

    Parameters
    ----------
    anatomy
        The joints that the markers suggest, in the T-pose.
    faults
        Sizes of the differences.
    rng
        Source of the variation; what is drawn does not depend on the sizes.

    Returns
    -------
    Anatomy
        In the same pose, with the same joint angles.
    """
    axes, points = dict(anatomy.axes), dict(anatomy.points)
    ankle = 0.0 if faults.same_body else faults.ankle_scale
    # axes are tilted in every direction, in a fixed order, so that equal seeds give equal people
    axis_sd = np.radians(faults.joint_scale * BODIES.axes)
    for name in sorted(axes):
        axes[name] = _tilted(axes[name], axis_sd * drawn(rng, 3))
        if name[1:] in BODIES.ankle_axes:
            first, second = np.radians(BODIES.ankle_axes[name[1:]]) * ankle * drawn(rng, 2)
            axes[name] = _tilted(axes[name], np.array([first, 0.0, second]))
    for name in sorted(points):
        joint = name.removeprefix("right_").removeprefix("left_")
        if joint in BODIES.joint_centers:
            shift = faults.joint_scale * BODIES.joint_centers[joint] * drawn(rng, 3)
            points[name] = points[name] + shift
    # true feet turn about two axes at different heights, true trunks bend in two joints
    for side in SIDES:
        lower = np.array([0.0, 0.0, ankle * BODIES.subtalar_drop])
        points[f"{side}_subtalar"] = points[f"{side}_ankle"] - lower
    points["mid_trunk"] = points["lumbar"]
    if not faults.same_body:
        away = points["lumbar"] - points["neck"]
        points["mid_trunk"] = points["neck"] + BODIES.mid_trunk * away
    # the orientations follow from joint angles and axes
    changed = replace(anatomy, axes=axes, points=points, ends=_ends(anatomy.ends, points))
    q = np.zeros((len(body.LINKS), 1))
    for name, value in anatomy.q.items():
        q[body.COLUMN[name]] = value
    nowhere = {s: np.zeros(3) for s in anatomy.rotations}
    jointed = body.Skeleton(axes_of(changed), nowhere, {}, (), (), np.zeros((0, 3)))
    turned = body.frames(jointed, (q,)).items()
    return replace(changed, rotations={s: frame.rotation[0][..., 0] for s, frame in turned})


def vary_inertias(
    inertias: Mapping[str, Inertia], faults: BodyFaults, rng: np.random.Generator
) -> dict[str, Inertia]:
    """Vary masses, centres and radii of gyration; the total mass stays.

    Parameters
    ----------
    inertias
        By segment.
    faults
        Sizes of the differences.
    rng
        Source of the variation.

    Returns
    -------
    dict of str to Inertia
        By segment.
    """
    # toes are only there to split a joint: their inertia is not varied
    names = [s for s, part in inertias.items() if part.mass > 0.01]
    draws = {s: (drawn(rng), drawn(rng, 3), drawn(rng)) for s in names}
    # in the Human Body Model both are one rigid segment
    if faults.same_body:
        draws["mid_trunk"] = draws["thorax"]
    # heavier and lighter segments, scaled so that the body's mass stays
    heavier = {s: 1 + faults.segment_scale * BODIES.mass * float(draws[s][0][0]) for s in names}
    total = sum(inertias[s].mass for s in names)
    scale = total / sum(inertias[s].mass * heavier[s] for s in names)
    varied = dict(inertias)
    for s in names:
        part, (_, away, wider) = inertias[s], draws[s]
        # tensor by m k²
        factor = scale * heavier[s]
        gyration = 1 + faults.segment_scale * BODIES.gyration * float(wider[0])
        varied[s] = Inertia(
            part.mass * factor,
            part.center + faults.segment_scale * BODIES.center * away,
            part.tensor * factor * gyration**2,
        )
    return varied


def with_shoes(
    inertias: Mapping[str, Inertia], anatomy: Anatomy, shoe_kg: float
) -> dict[str, Inertia]:
    """Add a shoe to each foot: a box over the length of the foot; mass in kg."""
    length, width, height = SHOE.size
    # tensor of a box: m/12 (b² + c²) about each axis
    square = np.array([width**2 + height**2, length**2 + height**2, length**2 + width**2])
    shod = dict(inertias)
    for side in SIDES:
        foot = f"{side}_foot"
        heel, tip, _ = anatomy.ends[foot]
        middle = (heel + tip) / 2
        middle[2] = SHOE.center_height
        shoe = Inertia(shoe_kg, middle, np.diag(shoe_kg / 12 * square))
        shod[foot] = shod[foot] + shoe.in_frame(anatomy.rotations[foot], anatomy.origin(foot))
    return shod


def _tilted(axis: Array, rotation: Array) -> Array:
    angle = float(np.linalg.norm(rotation))
    if angle == 0:
        return axis
    return np.asarray(rotation_about(rotation / angle, angle) @ axis)


def _ends(ends: Mapping[str, Array], points: Mapping[str, Array]) -> dict[str, Array]:
    """Move the ends of the limbs' segments with their joints."""
    joints = {
        **{"upper_arm": ("shoulder", "elbow"), "forearm": ("elbow", "wrist")},
        **{"hand": ("wrist", "knuckle"), "thigh": ("hip", "knee"), "shank": ("knee", "ankle")},
    }
    moved = dict(ends)
    for side in SIDES:
        for part, (first, second) in joints.items():
            near, far = points[f"{side}_{first}"], points[f"{side}_{second}"]
            moved[f"{side}_{part}"] = np.stack([near, far, ends[f"{side}_{part}"][2]])
    return moved


@dataclass(frozen=True, slots=True)
class ExtraJoints:
    """How a person moves in the joints that the Human Body Model does not have.

    Attributes
    ----------
    spine_share
        Fraction of the trunk's three angles that is in the mid trunk's joint, (3,).
    spine_wave, spine_phase
        Amplitude [rad] and phase [rad] of its own motion, (3,) each.
    knee
        Side's letter -> translation [m] and rotations [rad] that full flexion approaches, (3,).
    t_pose
        Coordinates in which all extra joints are at zero, (46,).
    """

    spine_share: Array
    spine_wave: Array
    spine_phase: Array
    knee: Mapping[str, Array]
    t_pose: Array

    def of_knee(self, letter: str, flexion: Array) -> Array:
        """Give a knee's translation and rotations at flexion angles (T,) [rad], (3, T)."""
        # 1 - e^(-φ/φ₀), from the T-pose on: most of it is in the first degrees of flexion
        straight = self.t_pose[INDEX[letter + "KneeFlexion"]]
        constant = np.radians(JOINTS.knee_flexion)
        bent = np.exp(-straight / constant) - np.exp(-flexion / constant)
        return np.outer(self.knee[letter], bent)

    def extend(self, q: Array, phase: Array, walking: Array) -> Array:
        """Add the extra coordinates.

        Parameters
        ----------
        q
            The coordinates of the Human Body Model, the trunk's as angles between pelvis and
            thorax, (46, T) [rad and m].
        phase
            Of the right gait cycle, (T,).
        walking
            From standing (0) to walking (1), (T,).

        Returns
        -------
        Array
            (55, T); the trunk's coordinates are those of the lumbar joint.
        """
        full = np.zeros((len(COORDINATES) + len(body.EXTRA), q.shape[1]))
        full[:N_Q] = q
        # what bends in the mid trunk's joint does not in the lumbar one: the thorax keeps its angle
        trunk = ("TrunkFlexion", "TrunkRightBend", "TrunkLeftTwist")
        for k, (name, harmonic) in enumerate(zip(trunk, JOINTS.spine_harmonic, strict=True)):
            i = INDEX[name]
            angle = 2 * np.pi * harmonic * phase + self.spine_phase[k]
            bend = self.spine_share[k] * (q[i] - self.t_pose[i])
            bend += self.spine_wave[k] * walking * np.cos(angle)
            full[N_Q + k] = bend
            full[i] -= bend
        for letter in self.knee:
            first = body.COLUMN[letter + body.KNEE[0]]
            flexion = q[INDEX[letter + "KneeFlexion"]]
            full[first : first + len(body.KNEE)] = self.of_knee(letter, flexion)
        return full


def draw_extra_joints(faults: BodyFaults, t_pose: Array, rng: np.random.Generator) -> ExtraJoints:
    """Draw a person's motion in the extra joints; none with ``same_body``."""
    spine, knee = (0.0, 0.0) if faults.same_body else (faults.spine_scale, faults.knee_scale)
    fraction = JOINTS.spine_fraction * (1 + JOINTS.spine_scatter * drawn(rng, 3))
    wave = np.radians(JOINTS.spine_wave) * (1 + JOINTS.spine_scatter * drawn(rng, 3))
    phase = rng.uniform(0, 2 * np.pi, 3)
    amplitude = np.append(JOINTS.knee[:1], np.radians(JOINTS.knee[1:]))
    knees = {
        letter: knee * amplitude * (1 + JOINTS.knee_scatter * drawn(rng, 3)) for letter in "RL"
    }
    return ExtraJoints(spine * fraction, spine * wave, phase, knees, t_pose)


def draw_wobbling_masses(
    inertias: Mapping[str, Inertia], faults: BodyFaults, rng: np.random.Generator
) -> tuple[body.WobblingMass, ...]:
    """Draw a person's wobbling masses; none with ``same_body`` or without size."""
    masses = []
    carriers = {"thorax": "thorax", "mid_trunk": "mid_trunk"}
    carriers |= {f"{side}_{part}": part for side in SIDES for part in ("thigh", "shank")}
    for name, tissue in carriers.items():
        scatter = 1 + TISSUE.scatter * drawn(rng, 3)
        fraction, frequency_hz, damping = np.array(TISSUE.wobbling[tissue]) * scatter
        # no more wobbles than the whole segment
        part, fraction = inertias[name], min(faults.wobble_scale * fraction, 1.0)
        if fraction > 0 and not faults.same_body:
            masses.append(
                body.WobblingMass(name, fraction * part.mass, part.center, frequency_hz, damping)
            )
    return tuple(masses)


@dataclass(frozen=True, slots=True)
class Person:
    """A person: name, sex, mass [kg], stature [m], age [years]."""

    name: str = "sub01"
    sex: Literal["male", "female"] = "male"
    mass_kg: float = 74.6
    height_m: float = 1.78
    age: float = 26.0


@dataclass(frozen=True, slots=True)
class VirtualSubject:
    """A person with a true body and a gait.

    Attributes
    ----------
    person
        Who it is.
    marker_set
        Name of the marker set that the person wears.
    skeleton
        The true body: joints, inertias and markers.
    extra_joints, wobbling
        How the person moves in joints that the Human Body Model does not have; soft tissue.
    soles, sole_yield_m
        Side -> sole; by how much the shoe is compressed under body weight [m].
    t_pose
        Coordinates of the T-pose, standing on the floor, (46,) [rad, m].
    standing
        The same with the arms hanging.
    step_parameters
        The person's spatiotemporal parameters.
    offset, gain, wander
        How the joint angles in walking differ from the mean pattern: added to the coordinates,
        factor of their motion, and standard deviation of slow variations, (46,).
    """

    person: Person
    marker_set: str
    skeleton: body.Skeleton
    extra_joints: ExtraJoints
    wobbling: tuple[body.WobblingMass, ...]
    soles: Mapping[str, Sole]
    sole_yield_m: float
    t_pose: Array
    standing: Array
    step_parameters: StepParameters
    offset: Array
    gain: Array
    wander: Array


def make_subject(
    person: Person,
    *,
    marker_set: str = "hbm2",
    individuality: float = 0.0,
    faults: BodyFaults | None = None,
    rng: np.random.Generator | None = None,
) -> VirtualSubject:
    """Give a person a body and a gait.

    Parameters
    ----------
    person
        Who it is.
    marker_set
        Name of the marker set: "hbm2" or "hbm1".
    individuality
        Scale of the differences between people in proportions and gait; 1 as in the population.
    faults
        How the body differs from what markers and the Human Body Model suggest; by default not at
        all.
    rng
        Source of everything individual.

    Returns
    -------
    VirtualSubject
        Ready to walk.
    """
    faults = faults or Faults.none().body
    shape_rng, body_rng, gait_rng = (rng or np.random.default_rng(0)).spawn(3)
    deviation = STYLE.proportions * individuality * drawn(shape_rng, len(fields(Proportions)))
    worn, proportions = marker_sets()[marker_set], Proportions(*(1 + deviation).tolist())
    source, shoe_scale = faults.inertias, faults.shoe_scale
    if faults.same_body:
        source, shoe_scale = "de_leva", 0.0

    # markers in the T-pose, the joints that they suggest, and the true ones
    # trochanters and toes locate joints, too, and are no markers of the Human Body Model 2
    anatomical = ("LGTRO", "RGTRO", "LTOE", "RTOE")
    points = tuple(dict.fromkeys((*marker_sets()["hbm2"].segment, *worn.segment, *anatomical)))
    position = t_pose(points, person.height_m, person.sex, proportions)
    position[:, 2] += shoe_scale * SHOE.sole
    at = dict(zip(points, position, strict=True))
    suggested = locate(at, frozenset(worn.landmark), person.sex, navel_share(person.sex))
    joint_rng, mass_rng, tissue_rng, motion_rng = body_rng.spawn(4)
    anatomy = vary(suggested, faults, joint_rng)

    # masses, those of the shoes last
    shoe_kg = shoe_scale * SHOE.mass
    bare_kg = person.mass_kg - 2 * shoe_kg
    inertias = inertias_of(anatomy, source, bare_kg, person.sex, person.height_m)
    inertias = vary_inertias(inertias, faults, mass_rng)
    wobbling = draw_wobbling_masses(inertias, faults, tissue_rng)
    if shoe_kg > 0:
        inertias = with_shoes(inertias, anatomy, shoe_kg)

    # markers on the segments, and the soles
    on_segment = [
        anatomy.rotations[s].T @ (at[name] - anatomy.origin(s)) for name, s in worn.segment.items()
    ]
    skeleton = body.Skeleton(
        axes_of(anatomy),
        offsets_of(anatomy),
        inertias,
        tuple(worn.segment),
        tuple(worn.segment.values()),
        np.array(on_segment),
    )
    landmarks = {mark: at[name] for mark, name in worn.landmark.items()}
    soles = {}
    for side in ("left", "right"):
        foot = f"{side}_foot"
        soles[side] = sole_of(landmarks, anatomy.rotations[foot], anatomy.origin(foot), side)

    # posture and gait
    q = np.array([anatomy.q.get(name, 0.0) for name in COORDINATES])
    standing = q.copy()
    for side in "RL":
        for name, angle in STYLE.hanging_arm.items():
            standing[INDEX[side + name]] = np.radians(angle)
    size, typical = size_of(standing), StepParameters()
    longer, wider = drawn(gait_rng, 2).tolist()
    # step length and width of the population are scaled by leg length
    longer = STYLE.step_length * longer - STYLE.treadmill_shortening
    step_parameters = replace(
        typical,
        step_m=STEP_M * size * (1 + individuality * longer),
        width_m=typical.width_m * size * (1 + individuality * STYLE.step_width * wider),
    )
    return VirtualSubject(
        person,
        marker_set,
        skeleton,
        draw_extra_joints(faults, q, motion_rng),
        wobbling,
        soles,
        shoe_scale * SHOE.sole_yield,
        q,
        standing,
        step_parameters,
        *_gait_style(individuality, gait_rng),
    )


def _gait_style(individuality: float, rng: np.random.Generator) -> tuple[Array, Array, Array]:
    """Draw offset, gain and wander of all coordinates."""
    count = len(COORDINATES)
    offset, gain, wander = np.zeros(count), np.ones(count), np.zeros(count)
    of_joint: dict[str, Array] = {}
    for i, name in enumerate(COORDINATES):
        joint = name[1:] if name[0] in "RL" else name
        arm = joint.startswith(("Shoulder", "Elbow", "ForeArm", "Wrist", "Hand"))
        # both sides of a person resemble each other: they have a draw of the joint in common
        if joint not in of_joint:
            of_joint[joint] = drawn(rng, 2)
        bilateral, wider = of_joint[joint]
        sd = np.radians(STYLE.offsets.get(joint, 0.0))
        deviation = STYLE.bilateral * bilateral + STYLE.unilateral * drawn(rng)[0]
        offset[i] = individuality * sd * deviation
        # the pelvis' rotation and obliquity vary in range, its place and tilt do not
        if joint in ("PelvisYaw", "PelvisRightRoll"):
            gain[i] += individuality * STYLE.pelvis_range * wider
        elif not joint.startswith("Pelvis"):
            gain[i] += individuality * (STYLE.arm_range if arm else STYLE.range) * wider
        # only joint angles wander: the pelvis goes where feet and balance need it
        if joint.startswith(("Pelvis", "ShoulderUp", "ShoulderForward", "ShoulderInward")):
            continue
        wander[i] = np.radians(STYLE.arm_wander if arm else STYLE.wander)
    return offset, gain, wander
