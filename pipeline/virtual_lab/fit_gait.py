"""Make ``gait.csv``: what adults' joints do over a gait cycle, as Fourier coefficients.

Run as ``python -m pipeline.virtual_lab.fit_gait NORMS.csv`` with the norms of Pinzone et al. (2014)
as published (columns quantity, name, unit, percent, centre_one_mean, centre_two_mean). Pelvis and
legs are fitted to the mean of both centres; trunk, head and arms follow round numbers from the
literature, named below, since the norms do not include them.
"""

import sys
from pathlib import Path
from typing import Final

import numpy as np
import pandas as pd

from hbm.spatial import Array

HARMONICS: Final = 8
HEADER: Final = """\
# Adults walking at self-chosen speed: Fourier coefficients [deg; shoulder points cm] of the middle's
# and the right side's coordinates over the right gait cycle. Made by pipeline/virtual_lab/fit_gait.py.
# Pelvis, hip, knee, ankle, foot: fitted to the published means of two centres, Pinzone O, Schwartz MH,
# Thomason P, Baker R (2014) The comparison of normative reference data from different gait analysis
# services, Gait Posture 40:286-290. Trunk and head: after Krebs et al. (1992) J Orthop Res 10:638;
# arms: after Murray, Sepic, Barnard (1967) Phys Ther 47:272; toes: after Leardini et al. (2007)
# Gait Posture 25:453. Coordinates "about" standing are added to the person's own standing posture.
"""
SIGNED: Final = {  # coordinate: name in the norms, sign
    "PelvisYaw": ("Pelvic Int/Ext", 1),
    "PelvisForwardPitch": ("Pelvis Ant/Pst", 1),
    "PelvisRightRoll": ("Pelvic Up/Dn", -1),
    "RHipFlexion": ("Hip Flx/Ext", 1),
    "RHipAbduction": ("Hip Add/Abd", -1),
    "RHipInternalRotation": ("Hip Int/Ext", 1),
    "RKneeFlexion": ("Knee Flx/Ext", 1),
    "RAnklePlantarFlexion": ("Ankle Dor/Pla", -1),
}
SYMMETRIC: Final = {"PelvisYaw": 1, "PelvisForwardPitch": 0, "PelvisRightRoll": 1}


def norms(path: Path) -> dict[str, Array]:
    """Read the mean angles of both centres, name -> 50 values over the cycle [deg]."""
    table = pd.read_csv(path)
    table = table[(table["quantity"] == "angle") & (table["percent"] < 100)]
    table["mean"] = (table["centre_one_mean"] + table["centre_two_mean"]) / 2
    return {str(name): part["mean"].to_numpy() for name, part in table.groupby("name")}


def fourier(values: Array, symmetric: int | None = None) -> Array:
    """Fit cosines and sines to one cycle, (HARMONICS + 1, 2); the middle of the body keeps only
    the odd (1) or even (0) ones, so that its right and left half cycles mirror each other."""
    spectrum = np.fft.rfft(values)[: HARMONICS + 1] / len(values)
    spectrum[1:] *= 2
    if symmetric is not None:
        spectrum[(1 - symmetric) :: 2] = 0
    return np.column_stack([spectrum.real, -spectrum.imag])


def wave(mean: float, *swings: tuple[int, float, float]) -> Array:
    """Give the coefficients of a mean and swings (harmonic, amplitude, phase of its peak)."""
    out = np.zeros((HARMONICS + 1, 2))
    out[0, 0] = mean
    for k, size, peak in swings:
        out[k] += size * np.cos(2 * np.pi * k * peak), size * np.sin(2 * np.pi * k * peak)
    return out


def coefficients(mean: dict[str, Array]) -> dict[tuple[str, str], Array]:
    """Give the coefficients of every coordinate, (coordinate, about) -> (HARMONICS + 1, 2)."""
    fitted = {
        name: sign * fourier(mean[norm], SYMMETRIC.get(name))
        for name, (norm, sign) in SIGNED.items()
    }
    pelvis_pitch = fitted["PelvisForwardPitch"].copy()
    pelvis_pitch[0] = 0
    thorax = wave(-0.5, (2, 1.0, 0.10)), wave(0, (1, 1.5, 0.28)), wave(0, (1, 4.0, 0.52))
    pelvis = pelvis_pitch, fitted["PelvisRightRoll"], fitted["PelvisYaw"]
    trunk = [t - p for t, p in zip(thorax, pelvis, strict=True)]
    head = [-share * t for share, t in zip((0.8, 0.7, 0.9), thorax, strict=True)]
    pitch = mean["Pelvis Ant/Pst"] - mean["Hip Flx/Ext"] + mean["Knee Flx/Ext"]
    about_standing = {
        "TrunkFlexion": trunk[0],
        "TrunkRightBend": trunk[1],
        "TrunkLeftTwist": trunk[2],
        "HeadFlexion": head[0],
        "HeadRightBend": head[1],
        "HeadLeftTwist": head[2],
        "RShoulderUp": wave(0, (2, 0.15, 0.15)),
        "RShoulderForward": wave(0, (1, 0.4, 0.52)),
        "RShoulderInward": wave(0, (1, 0.2, 0.52)),
        "RShoulderAbduction": wave(2, (2, 1.5, 0.05)),
        "RShoulderFlexion": wave(-4, (1, 15, 0.52), (2, 1.0, 0.05)),
        "RShoulderInternalRotation": wave(0, (1, 5, 0.52)),
        "RElbowFlexion": wave(14, (1, 9, 0.55), (2, 1.0, 0.05)),
        "RForeArmPronation": wave(0, (1, 5, 0.55)),
        "RWristFlexion": wave(2, (1, 3, 0.60)),
        "RHandAbduction": wave(0, (1, 3, 0.45)),
    }
    absolute = fitted | {
        "RToeFlexion": wave(-8, (1, 10, 0.10), (2, 8, 0.32)),
        "foot pitch": fourier(pitch - mean["Ankle Dor/Pla"]),
        "foot progression": fourier(mean["Foot Int/Ext"]),
    }
    return {(name, "zero"): c for name, c in absolute.items()} | {
        (name, "standing"): c for name, c in about_standing.items()
    }


def write(path: Path, table: dict[tuple[str, str], Array]) -> None:
    """Write the coefficients with their provenance."""
    rows = ["coordinate,about,harmonic,cosine,sine"]
    for (name, about), c in table.items():
        rows += [
            f"{name},{about},{k},{cosine:.4f},{sine:.4f}"
            for k, (cosine, sine) in enumerate(c)
            if k == 0 or abs(cosine) + abs(sine) > 5e-5
        ]
    path.write_text(HEADER + "\n".join(rows) + "\n", encoding="utf-8")


if __name__ == "__main__":
    write(Path(__file__).with_name("gait.csv"), coefficients(norms(Path(sys.argv[1]))))
