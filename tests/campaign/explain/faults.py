"""Faults of a trial that are seeded in the virtual laboratory, of sizes as usual as priors say."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, fields
from typing import Final

import numpy as np

from hbm.spatial import Array
from pipeline.explain.cause import Prior, priors
from tests.campaign.explain.plate_faults import PlateFault


def two_plates() -> tuple[PlateFault, PlateFault]:
    """Give two plates without a fault."""
    return PlateFault(), PlateFault()


@dataclass(frozen=True, slots=True, eq=False)
class Seeded:
    """What is wrong with a trial.

    Attributes
    ----------
    late_s
        Of both plates.
    plates
        Left and right.
    placement
        How both plates see the cameras' points: turned to the left [rad], shifted forward and to
        the left [m].
    sensors_late_s
        Of the accelerometers, since the treadmill was calibrated.
    pose_late_s, pivot_m
        Of the platform's channels, and of the height of the pitch axis as stated.
    mass_share
        Of the body's mass as stated.
    inertias, joints, skin
        Of what is added to the person's usual deviations, by published sizes.
    """

    late_s: float = 0.0
    plates: tuple[PlateFault, PlateFault] = field(default_factory=two_plates)
    placement: Array = field(default_factory=lambda: np.zeros(3))
    sensors_late_s: float = 0.0
    pose_late_s: float = 0.0
    pivot_m: float = 0.0
    mass_share: float = 0.0
    inertias: float = 0.0
    joints: float = 0.0
    skin: float = 0.0

    def __add__(self, other: "Seeded") -> "Seeded":
        values = {
            each.name: getattr(self, each.name) + getattr(other, each.name)
            for each in fields(self)
            if each.name != "plates"
        }
        left, right = (a + b for a, b in zip(self.plates, other.plates, strict=True))
        return Seeded(plates=(left, right), **values)

    def negative(self) -> "Seeded":
        """Give the opposite of a deviation of the person."""
        return Seeded(inertias=-self.inertias, joints=-self.joints, skin=-self.skin)


@dataclass(frozen=True, slots=True)
class Kind:
    """A kind of fault.

    Attributes
    ----------
    group
        In which `hbm explain` should see it.
    priors
        Keys of the priors of what it is made of.
    where
        "anywhere", on a treadmill that is "moving", or on one whose pose is known by "channels".
    draw
        Gives one of random size.
    usual
        What it takes to be without the usual part of it too.
    """

    group: str
    priors: tuple[str, ...]
    where: str
    draw: Callable[[np.random.Generator], Seeded]
    usual: Seeded = field(default_factory=Seeded)


def usual(kind: str, rng: np.random.Generator, count: int) -> Array:
    """Draw sizes of a kind of cause as its prior has them, (count,)."""
    return priors()[kind].size * rng.standard_normal(count)


def one_plate(fault: PlateFault, rng: np.random.Generator) -> Seeded:
    """Give one of both plates a fault."""
    left = bool(rng.integers(2))
    return Seeded(plates=(fault, PlateFault()) if left else (PlateFault(), fault))


def late(rng: np.random.Generator) -> Seeded:
    return Seeded(late_s=float(usual("delay", rng, 1)[0]))


def zero(rng: np.random.Generator) -> Seeded:
    force, moment = usual("zero_force", rng, 3), usual("zero_moment", rng, 3)
    return one_plate(PlateFault(zero=np.concatenate([force, moment])), rng)


def gain(rng: np.random.Generator) -> Seeded:
    return one_plate(PlateFault(gain=np.diag(usual("gain", rng, 6))), rng)


def cross_talk(rng: np.random.Generator) -> Seeded:
    shown = np.zeros((6, 6))
    shown[:2, 2] = usual("cross_talk", rng, 2)
    return one_plate(PlateFault(gain=shown), rng)


def place(rng: np.random.Generator) -> Seeded:
    return one_plate(PlateFault(place=usual("place", rng, 3)), rng)


def direction(rng: np.random.Generator) -> Seeded:
    return one_plate(PlateFault(direction=usual("direction", rng, 3)), rng)


def placement(rng: np.random.Generator) -> Seeded:
    turned = usual("direction", rng, 1)
    return Seeded(placement=np.concatenate([turned, usual("place", rng, 2)]))


def sensors_late(rng: np.random.Generator) -> Seeded:
    return Seeded(sensors_late_s=float(usual("accelerometer_delay_between_days", rng, 1)[0]))


def pose_late(rng: np.random.Generator) -> Seeded:
    return Seeded(pose_late_s=float(usual("pose_delay", rng, 1)[0]))


def pivot(rng: np.random.Generator) -> Seeded:
    return Seeded(pivot_m=float(usual("pivot", rng, 1)[0]))


def mass(rng: np.random.Generator) -> Seeded:
    return Seeded(mass_share=float(usual("body_mass", rng, 1)[0]))


def of_person(group: str, unit: Seeded) -> Kind:
    """Give a larger deviation of the person from the model, by the usual one."""
    return Kind(group, (), "anywhere", lambda _: unit, unit)


KINDS: Final[Mapping[str, Kind]] = {
    "plates late": Kind("delay", ("delay",), "anywhere", late),
    "zero": Kind("zero", ("zero_force", "zero_moment"), "anywhere", zero),
    "gain": Kind("gain", ("gain",), "anywhere", gain),
    "cross-talk": Kind("gain", ("cross_talk",), "anywhere", cross_talk),
    "place": Kind("place", ("place",), "anywhere", place),
    "direction": Kind("place", ("direction",), "anywhere", direction),
    "placement of both": Kind("place", ("place", "direction"), "anywhere", placement),
    "accelerometers late": Kind(
        "compensation", ("accelerometer_delay_between_days",), "moving", sensors_late
    ),
    "pose late": Kind("platform", ("pose_delay",), "channels", pose_late),
    "pivot": Kind("platform", ("pivot",), "channels", pivot),
    "mass as stated": Kind("inertia", ("body_mass",), "anywhere", mass),
    "inertias": of_person("inertia", Seeded(inertias=1.0)),
    "joints": of_person("markers", Seeded(joints=1.0)),
    "skin": of_person("skin", Seeded(skin=1.0)),
}
"""Those without priors are larger deviations of the person from the model: of segments' masses,
centres and radii of gyration; of joint centres; of the skin."""
ALWAYS_THERE: Final = ("inertia", "markers", "skin", "soft_tissue", "filter", "events")
"""Groups that are not absent in another body, whatever is seeded."""


def possible(known: Mapping[str, Prior], where: tuple[str, ...]) -> tuple[str, ...]:
    """Name the kinds that a trial can have, and that are among the causes so far."""
    return tuple(
        name
        for name, kind in KINDS.items()
        if kind.where in where and all(each in known for each in kind.priors)
    )
