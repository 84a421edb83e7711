"""The figures inside the page of a report: what each shows, how to read it, what to do."""

from base64 import b64encode
from dataclasses import dataclass
from pathlib import Path
from typing import Final

from pipeline.report.figures import drawn_conditions
from pipeline.run.load import Results
from pipeline.statistics.design import Design
from pipeline.trial.residuals import AXES

MEDIA_TYPES: Final = {".svg": "image/svg+xml", ".png": "image/png"}


@dataclass(frozen=True, slots=True)
class Picture:
    """A figure inside the page.

    Attributes
    ----------
    name
        In ``figures/``.
    shows, judge, act
        What it shows, what good and bad look like, and what to do.
    data_uri
        Its file.
    """

    name: str
    shows: str
    judge: str
    act: str
    data_uri: str


def study_pictures(results: Results, folder: Path, design: Design) -> tuple[Picture, ...]:
    """Give the figures over all subjects.

    Parameters
    ----------
    results
        The trials.
    folder
        Of the drawn figures.
    design
        The design that they were drawn for.

    Returns
    -------
    tuple of Picture
        The gait cycle of every condition, and the means.
    """
    plates = "with the plates as measured"
    if results.residuals["compensated"].any():
        plates = "without (no IC) and with inertia compensation (IC)"
    present = set(results.cycles["condition"].unique())
    of_conditions = [
        _gait_cycle_picture(folder, condition, plates, design, design.reference in present)
        for condition in drawn_conditions(results.cycles, design)
    ]
    return (*of_conditions, _means_picture(folder, plates, design))


def _gait_cycle_picture(
    folder: Path, condition: str, plates: str, design: Design, has_reference: bool
) -> Picture:
    reference = ""
    if condition != design.reference and has_reference:
        reference = f", and in {design.reference}"
    check = "check markers, events and plates in the viewer at this percent of the cycle."
    act = f"Where the line has a peak that the reference has not, {check}"
    if design.compensated:
        act = (
            "Where IC leaves a peak while the platform moves, check delay and calibration of the "
            f"accelerometers; where all lines have it, {check}"
        )
    return _picture(
        folder / f"gait_cycle_{condition}.svg",
        f"Residuals over the gait cycle in {condition} {plates}{reference}; mean ± SD. x forward, "
        "y right, z up; moments about the midpoint of the hip joints. Cycles of the left foot are "
        "mirrored (Fy, Mx and Mz change sign). The panels differ in scale.",
        "Good: the line stays within the band of the reference, a few per cent of body weight from "
        "zero. Bad: an offset, a peak that the reference has not, or a band that widens at one "
        "instant of the cycle.",
        act,
    )


def _means_picture(folder: Path, plates: str, design: Design) -> Picture:
    judge = (
        "Good: the line is level, and the subjects' thin lines run alike. Bad: one condition "
        "rises, or a single subject does."
    )
    if design.compensated:
        judge = (
            "Good: the lines with compensation are level and near the reference, and the subjects' "
            "thin lines run alike. Bad: one condition rises, or a single subject does; lines that "
            "are not parallel are an interaction."
        )
    return _picture(
        folder / "marginal_means.svg",
        f"Mean RMS residual of every condition {plates}, with 95 % confidence intervals; thin "
        "lines are subjects.",
        judge,
        "Where all subjects rise, look at the condition's gait cycle above; where one does, look "
        "at the quality and the notes of this subject's trials below. Intervals of single means "
        "may overlap though the paired difference is clear: see the tests above.",
    )


def example_pictures(folder: Path, subject: str | None) -> tuple[Picture, ...]:
    """Give the figures of one subject's single cycles; none without a subject."""
    if subject is None:
        return ()
    return tuple(
        _picture(
            folder / f"raw_{axis}.png",
            f"Residual {axis} of {subject}, every cycle.",
            "Good: every cycle is like the others of its condition. Bad: single cycles stand out, "
            "or the level drifts with time.",
            "Look at a cycle that stands out in the viewer: a foot on both plates, a wrong event "
            "or a lost marker. A drift is one of the plates: tare them.",
        )
        for axis in AXES
    )


def _picture(path: Path, shows: str, judge: str, act: str) -> Picture:
    data = b64encode(path.read_bytes()).decode()
    return Picture(path.stem, shows, judge, act, f"data:{MEDIA_TYPES[path.suffix]};base64,{data}")
