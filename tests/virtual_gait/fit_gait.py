"""Make ``gait.csv``: the mean gait pattern of adults, as Fourier coefficients of all coordinates.

Run as ``python -m tests.virtual_gait.fit_gait NORMS.csv`` with the norms of Pinzone et al. (2014)
as published (columns quantity, name, unit, percent, centre_one_mean, centre_one_sd and so on). The
norms give pelvis and legs; trunk, head and arms follow rounded values from the literature that is
cited in the file. `gait_optimum` then finds the nearest gait that the reference person's equations
of motion allow.
"""

import argparse
from dataclasses import replace
from pathlib import Path
from typing import Final

import numpy as np
import pandas as pd

from hbm.coordinates import COORDINATES, INDEX, N_Q, TREE
from hbm.spatial import Array
from pipeline.virtual_lab.person.gait import GAIT
from pipeline.virtual_lab.person.subject import Person, VirtualSubject, make_subject
from tests.virtual_gait.gait_optimum import Target, nodes, optimise

GAIT_CSV: Final = Path(__file__).parents[2] / "pipeline" / "virtual_lab" / "person" / "gait.csv"
HARMONICS: Final = 8
"""Highest harmonic of the gait cycle, 7.4 Hz: above it joint angles in walking have very little."""
SLOPES_DEG: Final = (-10.0, -5.0, 0.0, 5.0, 10.0)
"""Slopes of the belt: the range of the platform's pitch."""
HEADER: Final = """\
# Mean gait pattern of adults at 1.3 m/s: Fourier coefficients [deg; m for PelvisX, Y, Z and the
# shoulder points] of the coordinates of trunk and right side over the right gait cycle from initial
# contact. Made by tests/virtual_gait/fit_gait.py: for every slope of the belt, the gait of a
# reference man of 1.78 m that is nearest to the published norms (of level walking) and satisfies
# the equations of motion with the feet on the belt. A positive slope rises forward.
# Pelvis, hip, knee, ankle, foot: means of two centres, Pinzone O, Schwartz MH, Thomason P, Baker R
# (2014) The comparison of normative reference data from different gait analysis services, Gait
# Posture 40:286-290. Trunk, head: after Krebs et al. (1992) Phys Ther 72:505; arms: after Murray
# et al. (1967) Phys Ther 47:272; toes: after Leardini et al. (2007) Gait Posture 25:453.
# "about" is what a coordinate is relative to: zero, or the person's own standing posture.
"""
NORM: Final = {
    "PelvisYaw": ("Pelvic Int/Ext", 1),
    "PelvisForwardPitch": ("Pelvis Ant/Pst", 1),
    "PelvisRightRoll": ("Pelvic Up/Dn", -1),
    "RHipFlexion": ("Hip Flx/Ext", 1),
    "RHipAbduction": ("Hip Add/Abd", -1),
    "RHipInternalRotation": ("Hip Int/Ext", 1),
    "RKneeFlexion": ("Knee Flx/Ext", 1),
    "RAnklePlantarFlexion": ("Ankle Dor/Pla", -1),
}
"""Coordinate -> its name in the norms, and its sign relative to them."""
FREE_SD: Final = {
    "PelvisX": 0.02,
    "PelvisY": 0.03,
    "PelvisZ": 0.03,
    "RFootPronation": 3.0,
    "RToeFlexion": 1.0,
}
"""Standard deviations of coordinates without norms that balance and feet determine [m and deg];
chosen."""
OTHER_SD_DEG: Final = 2.0
OTHER_SD_M: Final = 0.002
"""Of all other coordinates without norms; chosen."""
NORM_SD_SHARE: Final = 0.5
"""Share of the norms' standard deviations that is used: that of the mean is smaller than that
between people."""
ANKLE_ZERO_DEG: Final = -3.0
"""Zero of ankle dorsiflexion relative to the norms: heel and second metatarsal head are not equally
high."""
STANDING: Final = ("PelvisZ", "Trunk", "Head", "RShoulder", "RElbow", "RForeArm", "RWrist", "RHand")
"""Coordinates that are relative to the standing posture, by the beginning of their names."""
PELVIS_LOWER_M: Final = 0.03
"""How much lower than in standing the pelvis is on average; usual at this speed."""
VERTICAL_WAVES: Final = ((2, 0.22, 0.065), (4, 0.03, 0.03))
"""Harmonic, amplitude [body weights] and phase of the peak of the vertical force: two peaks of
about 1.2 body weights, as usual at this speed."""


def read_norms(path: Path) -> tuple[dict[str, Array], dict[str, float]]:
    """Read mean angles at 50 phases of the cycle, and their mean SD, by name [deg]."""
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


def wave(mean: float, *waves: tuple[int, float, float]) -> Array:
    """Give the coefficients of a mean and of waves (harmonic, amplitude, phase of the peak)."""
    out = np.zeros((HARMONICS + 1, 2))
    out[0, 0] = mean
    for k, amplitude, peak in waves:
        angle = 2 * np.pi * k * peak
        out[k] += amplitude * np.cos(angle), amplitude * np.sin(angle)
    return out


def evaluate(coefficients: Array, phase: Array) -> Array:
    """Evaluate a Fourier series at phases in cycles."""
    angle = 2 * np.pi * np.outer(phase, np.arange(len(coefficients)))
    return np.asarray(np.cos(angle) @ coefficients[:, 0] + np.sin(angle) @ coefficients[:, 1])


def published(mean: dict[str, Array]) -> dict[str, Array]:
    """Give the coefficients of norms and literature, by coordinate [deg, m].

    Amplitudes and phases of trunk, head, arms and toes are rounded values of the works that the
    header cites; the head rotates against the trunk, so that it keeps its direction.
    """
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
    """Give the factor from the unit of the table to m or rad."""
    return 1.0 if TREE[INDEX[name]].translates else np.pi / 180


def target_of(
    subject: VirtualSubject, mean: dict[str, Array], spread: dict[str, float]
) -> tuple[Target, Array]:
    """Give the optimisation's target, and foot pitch and progression as coefficients [deg]."""
    series = published(mean)
    joints, sds = np.zeros((len(nodes()), N_Q)), np.zeros(N_Q)
    for i, name in enumerate(COORDINATES):
        left = name.startswith("L")
        source = "R" + name[1:] if left else name
        phase = nodes() + (0.5 if left else 0.0)
        if source in series:
            joints[:, i] = to_si(name) * evaluate(series[source], phase)
        if source.startswith(STANDING[1:]):
            joints[:, i] += subject.standing[i]
        other = OTHER_SD_M if TREE[i].translates else OTHER_SD_DEG
        sd = FREE_SD.get(source, other)
        if source in NORM:
            sd = NORM_SD_SHARE * spread[NORM[source][0]]
        sds[i] = to_si(name) * sd
    joints[:, INDEX["PelvisZ"]] = subject.standing[INDEX["PelvisZ"]] - PELVIS_LOWER_M

    pitch = (
        mean["Pelvis Ant/Pst"] - mean["Hip Flx/Ext"] + mean["Knee Flx/Ext"] - mean["Ankle Dor/Pla"]
    )
    feet = np.stack([fourier(pitch), fourier(mean["Foot Int/Ext"])])
    both = [[np.radians(evaluate(c, nodes() + shift)) for shift in (0.0, 0.5)] for c in feet]
    vertical = evaluate(wave(1.0, *VERTICAL_WAVES), nodes())
    pitch, heading = np.array(both)
    target = Target(GAIT.speed, GAIT.stride, joints, sds, pitch, heading, vertical)
    return target, feet


def write(
    path: Path, subject: VirtualSubject, gaits: dict[float, dict[str, Array]], feet: Array
) -> None:
    """Write the coefficients with their sources; ``gaits`` by slope [deg]."""
    rows = ["slope_deg,coordinate,about,harmonic,cosine,sine"]
    for slope, gait in gaits.items():
        table = {"foothold": gait["foothold"][:1, None] * [[1.0, 0.0]]}
        table |= {"foot pitch": feet[0], "foot progression": feet[1]}
        for name, c in gait.items():
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


def main() -> None:
    parser = argparse.ArgumentParser(
        prog="python -m tests.virtual_gait.fit_gait", description=__doc__
    )
    parser.add_argument("norms", type=Path, help="CSV file of the norms as published")
    norms = read_norms(parser.parse_args().norms)
    reference = make_subject(Person())
    level, feet = target_of(reference, *norms)
    gaits = {
        slope: optimise(reference, replace(level, slope=float(np.radians(slope))), HARMONICS)
        for slope in SLOPES_DEG
    }
    write(GAIT_CSV, reference, gaits, feet)


if __name__ == "__main__":
    main()
