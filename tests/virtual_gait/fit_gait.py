"""Make ``gait.csv``: how adults walk, as Fourier coefficients of all coordinates.

Run as ``python -m tests.virtual_gait.fit_gait NORMS.csv`` with the norms of Pinzone et al. (2014)
as published (columns quantity, name, unit, percent, centre_one_mean, centre_one_sd and so on). The
norms give pelvis and legs; trunk, head and arms follow round numbers from the literature, named in
the file. `gait_optimum` then finds the nearest walk that the reference person can walk.
"""

import sys
from dataclasses import replace
from pathlib import Path
from typing import Final

import numpy as np
import pandas as pd

from hbm.coordinates import COORDINATES, INDEX, N_Q, TREE
from hbm.spatial import Array
from pipeline.virtual_lab.person.subject import Person, VirtualSubject, make_subject
from tests.virtual_gait.gait_optimum import Target, nodes, optimise

HARMONICS: Final = 8
SPEED_MPS: Final = 1.3
STRIDE_S: Final = 1.08
SLOPES_DEG: Final = (-10.0, -5.0, 0.0, 5.0, 10.0)
HEADER: Final = """\
# How adults walk at 1.3 m/s: Fourier coefficients [deg; m for PelvisX, Y, Z and shoulder points] of
# the coordinates of the middle and the right side over the right gait cycle from initial contact.
# Made by tests/virtual_gait/fit_gait.py: for every slope of the belt the walk of a reference man
# of 1.78 m that is nearest to the published norms (of level walking) and satisfies the equations of
# motion on the ground. A positive slope rises forward.
# Pelvis, hip, knee, ankle, foot: means of two centres, Pinzone O, Schwartz MH, Thomason P, Baker R
# (2014) The comparison of normative reference data from different gait analysis services, Gait
# Posture 40:286-290. Trunk, head: after Krebs et al. (1992) Phys Ther 72:505; arms: after Murray
# et al. (1967) Phys Ther 47:272; toes: after Leardini et al. (2007) Gait Posture 25:453.
# "about" says what a coordinate is counted from: zero, or the person's own standing posture.
"""
NORM: Final = {  # coordinate: name in the norms, sign
    "PelvisYaw": ("Pelvic Int/Ext", 1),
    "PelvisForwardPitch": ("Pelvis Ant/Pst", 1),
    "PelvisRightRoll": ("Pelvic Up/Dn", -1),
    "RHipFlexion": ("Hip Flx/Ext", 1),
    "RHipAbduction": ("Hip Add/Abd", -1),
    "RHipInternalRotation": ("Hip Int/Ext", 1),
    "RKneeFlexion": ("Knee Flx/Ext", 1),
    "RAnklePlantarFlexion": ("Ankle Dor/Pla", -1),
}
FREE_SPREAD: Final = {  # of what the norms do not say [deg or m]
    "PelvisX": 0.02,
    "PelvisY": 0.03,
    "PelvisZ": 0.03,
    "RFootPronation": 3.0,
    "RToeFlexion": 1.0,
}
OTHER_SPREAD: Final = 2.0, 0.002  # [deg], [m]
ANKLE_ZERO_DEG: Final = -3.0  # heel and second metatarsal head are not equally high
STANDING: Final = ("PelvisZ", "Trunk", "Head", "RShoulder", "RElbow", "RForeArm", "RWrist", "RHand")
LOWER_M: Final = 0.03  # how much lower than standing the pelvis is on average


def read_norms(path: Path) -> tuple[dict[str, Array], dict[str, float]]:
    """Read mean angles over 50 values of the cycle and their mean spread, by name [deg]."""
    table = pd.read_csv(path)
    table = table[(table["quantity"] == "angle") & (table["percent"] < 100)]
    both = {
        kind: (table[f"centre_one_{kind}"] + table[f"centre_two_{kind}"]) / 2
        for kind in ("mean", "sd")
    }
    names = table["name"]
    mean = {str(n): both["mean"][names == n].to_numpy() for n in names.unique()}
    return mean, {n: float(both["sd"][names == n].mean()) for n in mean}


def fourier(values: Array) -> Array:
    """Fit cosines and sines to one cycle, (HARMONICS + 1, 2)."""
    spectrum = np.fft.rfft(values)[: HARMONICS + 1] / len(values)
    spectrum[1:] *= 2
    return np.column_stack([spectrum.real, -spectrum.imag])


def wave(mean: float, *swings: tuple[int, float, float]) -> Array:
    """Give the coefficients of a mean and swings (harmonic, amplitude, phase of its peak)."""
    out = np.zeros((HARMONICS + 1, 2))
    out[0, 0] = mean
    for k, size, peak in swings:
        out[k] += size * np.cos(2 * np.pi * k * peak), size * np.sin(2 * np.pi * k * peak)
    return out


def evaluate(coefficients: Array, phase: Array) -> Array:
    """Evaluate a Fourier series at phases in cycles."""
    angle = 2 * np.pi * np.outer(phase, np.arange(len(coefficients)))
    return np.asarray(np.cos(angle) @ coefficients[:, 0] + np.sin(angle) @ coefficients[:, 1])


def wanted(mean: dict[str, Array]) -> dict[str, Array]:
    """Give the coefficients of what the norms and the literature say, by coordinate [deg, m]."""
    legs = {name: sign * fourier(mean[norm]) for name, (norm, sign) in NORM.items()}
    legs["RAnklePlantarFlexion"][0, 0] += ANKLE_ZERO_DEG
    thorax = wave(-0.5, (2, 1.0, 0.10)), wave(0, (1, 1.5, 0.28)), wave(0, (1, 4.0, 0.52))
    pelvis = [legs[n].copy() for n in ("PelvisForwardPitch", "PelvisRightRoll", "PelvisYaw")]
    pelvis[0][0] = 0
    trunk = [t - p for t, p in zip(thorax, pelvis, strict=True)]
    head = [-share * t for share, t in zip((0.8, 0.7, 0.9), thorax, strict=True)]
    return legs | {
        **dict(zip(("TrunkFlexion", "TrunkRightBend", "TrunkLeftTwist"), trunk, strict=True)),
        **dict(zip(("HeadFlexion", "HeadRightBend", "HeadLeftTwist"), head, strict=True)),
        "RShoulderUp": wave(0, (2, 0.0015, 0.15)),
        "RShoulderForward": wave(0, (1, 0.004, 0.52)),
        "RShoulderInward": wave(0, (1, 0.002, 0.52)),
        "RShoulderAbduction": wave(2, (2, 1.5, 0.05)),
        "RShoulderFlexion": wave(-4, (1, 15, 0.52), (2, 1.0, 0.05)),
        "RShoulderInternalRotation": wave(0, (1, 5, 0.52)),
        "RElbowFlexion": wave(14, (1, 9, 0.55), (2, 1.0, 0.05)),
        "RForeArmPronation": wave(0, (1, 5, 0.55)),
        "RWristFlexion": wave(2, (1, 3, 0.60)),
        "RHandAbduction": wave(0, (1, 3, 0.45)),
        "RToeFlexion": wave(-8, (1, 10, 0.10), (2, 8, 0.32)),
    }


def to_si(name: str) -> float:
    """Give the factor from the table's unit to m or rad."""
    return 1.0 if TREE[INDEX[name]].translates else np.pi / 180


def target_of(
    subject: VirtualSubject, mean: dict[str, Array], spread: dict[str, float]
) -> tuple[Target, Array]:
    """Give the optimisation's target, and foot pitch and progression as coefficients [deg]."""
    series = wanted(mean)
    joints, widths = np.zeros((len(nodes()), N_Q)), np.zeros(N_Q)
    for i, name in enumerate(COORDINATES):
        left = name.startswith("L")
        source = "R" + name[1:] if left else name
        phase = nodes() + (0.5 if left else 0.0)
        if source in series:
            joints[:, i] = to_si(name) * evaluate(series[source], phase)
        if source.startswith(STANDING[1:]):
            joints[:, i] += subject.standing[i]
        other = OTHER_SPREAD[1] if TREE[i].translates else OTHER_SPREAD[0]
        width = 0.5 * spread[NORM[source][0]] if source in NORM else FREE_SPREAD.get(source, other)
        widths[i] = to_si(name) * width
    joints[:, INDEX["PelvisZ"]] = subject.standing[INDEX["PelvisZ"]] - LOWER_M

    pitch = (
        mean["Pelvis Ant/Pst"] - mean["Hip Flx/Ext"] + mean["Knee Flx/Ext"] - mean["Ankle Dor/Pla"]
    )
    feet = np.stack([fourier(pitch), fourier(mean["Foot Int/Ext"])])
    both = [[np.radians(evaluate(c, nodes() + late)) for late in (0.0, 0.5)] for c in feet]
    beat = 4 * np.pi
    vertical = (
        1 + 0.22 * np.cos(beat * (nodes() - 0.065)) + 0.03 * np.cos(2 * beat * (nodes() - 0.03))
    )
    pitch, heading = np.array(both)
    target = Target(SPEED_MPS, STRIDE_S, joints, widths, pitch, heading, vertical)
    return target, feet


def write(
    path: Path, subject: VirtualSubject, walks: dict[float, dict[str, Array]], feet: Array
) -> None:
    """Write the coefficients with their provenance; ``walks`` by slope [deg]."""
    rows = ["slope_deg,coordinate,about,harmonic,cosine,sine"]
    for slope, walk in walks.items():
        table = {"foothold": walk["foothold"][:1, None] * [[1.0, 0.0]]}
        table |= {"foot pitch": feet[0], "foot progression": feet[1]}
        for name, c in walk.items():
            if name != "foothold":
                own = np.zeros_like(c)
                own[0, 0] = subject.standing[INDEX[name]] if name.startswith(STANDING) else 0.0
                table[name] = (c - own) / to_si(name)
        for name, c in table.items():
            about = "standing" if name.startswith(STANDING) else "zero"
            rows += [
                f"{slope:g},{name},{about},{k},{cosine:.5f},{sine:.5f}"
                for k, (cosine, sine) in enumerate(c)
                if abs(cosine) + abs(sine) > 5e-6
            ]
    path.write_text(HEADER + "\n".join(rows) + "\n", encoding="utf-8")


if __name__ == "__main__":
    reference = make_subject(Person())
    level, feet = target_of(reference, *read_norms(Path(sys.argv[1])))
    walks = {
        slope: optimise(reference, replace(level, slope=float(np.radians(slope))), HARMONICS)
        for slope in SLOPES_DEG
    }
    write(Path(__file__).with_name("gait.csv"), reference, walks, feet)
