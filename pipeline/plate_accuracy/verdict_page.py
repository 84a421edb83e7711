"""The verdict on plates as text and files: errors beside their limits, and the calibration."""

from collections.abc import Sequence
from datetime import UTC, datetime
from importlib.metadata import version
from pathlib import Path
from typing import Final

import numpy as np
import pandas as pd

from compensation import PlateCalibrations
from compensation.plate_calibration import to_json
from hbm.spatial import GRAVITY_MPS2
from pipeline.config.plate_study import FILE, PlatesStudy
from pipeline.io.write import markdown, write_text
from pipeline.plate_accuracy.accuracy import PlateAccuracy
from pipeline.plate_accuracy.judgement import DISPLAY_UNITS, Judged, rounded
from pipeline.plate_accuracy.verdict import PlateVerdict
from pipeline.run.job import file_digest

CALIBRATION: Final = "plate_calibration.json"
TOTAL_NOTE: Final = (
    "Total errors: root mean square over the loads of one foot in walking (vertical force 0.75 to "
    "1.2, forward ± 0.25, lateral ± 0.05 body weights; centre of pressure up to 0.4 m along and "
    "0.1 m across from the middle of the plate) of a person of {mass:g} kg; moments about a centre "
    "of mass 1 m above the belt. They hold the plate's response to the true wrench, zero, a minute "
    "of drift, and scatter. The weights were {lightest:g} to {heaviest:g} kg: at loads above the "
    "largest recorded one ({largest:.0f} N), the straight and the squared part of the response are "
    "extrapolated, and their uncertainty with them; any other deviation there is not known. Errors "
    "of the stated masses, of the marker's place above a weight's centre and of center_height_m "
    "are not in the intervals."
)


def verdict_sections(found: PlateAccuracy, verdicts: Sequence[PlateVerdict]) -> list[str]:
    """Give, per plate, every error beside its limit, what to correct and what is not known."""
    lines = []
    for verdict in verdicts:
        lines += [
            f"## {verdict.belt} plate: {verdict.verdict}",
            markdown(pd.DataFrame([_row(one) for one in (*verdict.judged, *verdict.corrected)])),
        ]
        if verdict.notes:
            lines.append(_listed([f"{note.level}: {note} [{note.code}]" for note in verdict.notes]))
        alike = [one for one in verdict.judged if one.alike and one.status != "within"]
        if alike:
            lines.append(
                "Weigh the masses and measure center_height_m before the plate is blamed:\n\n"
                + _listed([f"{one.name}: {one.alike} would look the same" for one in alike])
            )
        if verdict.corrections:
            lines.append("To correct:\n\n" + _listed(verdict.corrections))
        elif verdict.calibration is not None:
            lines.append(
                f"{CALIBRATION} holds a correction of this plate, which is not known to be enough."
            )
        elif verdict.corrected:
            lines.append(
                "No calibration of this plate is written: with it, a total error would be beyond "
                "its limit and larger than without it."
            )
        lines.append("Not examined:\n\n" + _listed((*verdict.to_record, *verdict.remarks)))
    if any(verdict.corrections for verdict in verdicts):
        lines.append(
            f"The calibration is in {CALIBRATION}; study.toml names it:\n\n"
            f'```toml\n[plates]\ncalibration = "{CALIBRATION}"\n```'
        )
    masses = [trial.weight.mass_kg for trial in found.trials]
    note = TOTAL_NOTE.format(
        mass=found.study.file.body_mass_kg,
        lightest=min(masses),
        heaviest=max(masses),
        largest=GRAVITY_MPS2 * max(masses),
    )
    return [*lines, note]


def judged_table(verdicts: Sequence[PlateVerdict]) -> pd.DataFrame:
    """Give every error beside its limit, one row each, in SI units."""
    rows = [
        [verdict.belt, one.name, one.size, one.low, one.high, one.limit, one.unit, one.status]
        for verdict in verdicts
        for one in (*verdict.judged, *verdict.corrected)
    ]
    columns = ["belt", "error", "size", "low", "high", "limit", "unit", "status"]
    return pd.DataFrame(rows, columns=columns)


def write_calibration(study: PlatesStudy, verdicts: Sequence[PlateVerdict], out: Path) -> None:
    """Write ``plate_calibration.json`` with the plates that need one, if any does."""
    plates = tuple(one.calibration for one in verdicts if one.calibration is not None)
    if not plates:
        return
    provenance = {
        "study": study.file.name,
        "sha256": file_digest(study.folder / FILE),
        "made": datetime.now(UTC).isoformat(timespec="seconds"),
        "program": f"hbm-residuals {version('hbm-residuals')}",
    }
    write_text(to_json(PlateCalibrations(plates, provenance)), out / CALIBRATION)


def use_of_calibration(verdicts: Sequence[PlateVerdict], out: Path) -> str | None:
    """Say how to use the calibration that was written; None where no plate is to be corrected."""
    if not any(one.corrections for one in verdicts):
        return None
    return (
        f'to correct trials, in study.toml: [plates] calibration = "{out / CALIBRATION}"; '
        f"for one trial: hbm residuals TRIAL --plate-calibration {out / CALIBRATION}"
    )


def _row(one: Judged) -> dict[str, str]:
    scale, unit = DISPLAY_UNITS.get(one.unit, (1.0, one.unit))
    width = scale * (one.high - one.low) / 2
    size, low, high = (rounded(scale * x, width) for x in (one.size, one.low, one.high))
    known = np.isfinite(one.size)
    return {
        "error": one.name,
        "size": size if known else "–",
        "95 % interval": f"{low} to {high}" if known else "–",
        "limit": f"{scale * one.limit:g}",
        "unit": unit,
        "status": one.status,
    }


def _listed(items: Sequence[str]) -> str:
    return "\n".join(f"- {item}" for item in items)
