"""The page of a laboratory, ``laboratory.html``: calibration, checks, plates, calibration signals.

Each command writes its own part into ``laboratory.json`` and leaves the parts of the others as they
are; the page shows that file.
"""

import os
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from datetime import UTC, datetime
from pathlib import Path
from typing import Final, Literal
from urllib.parse import quote

import numpy as np
import pandas as pd
from pydantic import TypeAdapter

from compensation import Calibration, from_json
from compensation.inertia.quality import (
    MAX_LEFT,
    MAX_ZERO_CHANGE,
    PERSON_KG,
    UNITS,
    LeftOver,
    lightest_kg,
)
from compensation.protocol import ADVISED_PLATFORM_SIGNAL
from hbm.notes import Note, provenance, warnings_of
from hbm.numbers import read_numbers
from hbm.spatial import WRENCH_COMPONENTS
from hbm.spelling import written
from pipeline.config.schema import StudyFile
from pipeline.config.study import Study
from pipeline.figures.style import drawing
from pipeline.io.input_file import file_digest, read_text
from pipeline.io.write import read_csv, write_csv, write_text
from pipeline.report.blocks import Block, Check, Drawn, Section, Table, write_page
from pipeline.report.empty_treadmill import (
    PITCH,
    SWAY,
    EmptyTreadmill,
    spectrum_figure,
    time_figure,
)
from pipeline.trial.ground.calibrations import CalibrationCheck
from pipeline.trial.ground.laboratory import BESIDE
from pipeline.trial.result import StoredNote

PAGE: Final = "laboratory.html"
STATE: Final = "laboratory.json"
CHECKS: Final = "laboratory_checks.csv"
PartName = Literal["calibration", "check", "plates", "ranking"]
TITLES: Final[Mapping[PartName, str]] = {
    "calibration": "Calibration of the moving treadmill",
    "check": "Checks on other days",
    "plates": "Plates under known weights",
    "ranking": "Ranking of calibration signals",
}
LIMITS: Final = read_numbers("pipeline.report", "thresholds.toml", "laboratory")
NEW_FIT: Final = "record the empty treadmill, hbm calibration fit"


@dataclass(frozen=True, slots=True)
class Part:
    """What one command adds to the page.

    Attributes
    ----------
    name
        Its place in the page.
    verdict
        Tables of two columns at the top of the page: what was asked, and the answer.
    tables, figures
        Below.
    of
        SHA-256 of the calibration that the part is about; empty where it is about none.
    warnings
        At the top of the page.
    """

    name: PartName
    verdict: Sequence[Table]
    tables: Sequence[Table] = ()
    figures: Sequence[Drawn] = ()
    of: str = ""
    warnings: Sequence[StoredNote] = ()


PARTS: Final = TypeAdapter(dict[PartName, Part])


def write_laboratory(folder: Path, *parts: Part, verdicts: Sequence[Part] = ()) -> Path:
    """Write parts into ``laboratory.json`` of a folder, and the page that shows it.

    Parameters
    ----------
    folder
        Of both.
    *parts
        They replace those of their names. Parts of another calibration go.
    verdicts
        Parts of which the verdict alone replaces that of the same name, where there is one.

    Returns
    -------
    Path
        ``laboratory.html``.

    Raises
    ------
    ValueError
        If ``laboratory.json`` is damaged.
    """
    page, state = folder / PAGE, folder / STATE
    shown = dict[PartName, Part]()
    if state.exists():
        try:
            shown = PARTS.validate_json(read_text(state))
        except ValueError as error:
            raise ValueError(
                f"{state}: damaged, or of another version; move it away, and run the commands "
                "whose parts the page is to show again"
            ) from error
    of = {part.of for part in (*parts, *verdicts)} - {""}
    shown = {name: part for name, part in shown.items() if not of or part.of in {"", *of}}
    shown |= {part.name: part for part in parts}
    for part in verdicts:
        shown[part.name] = replace(shown.get(part.name, part), verdict=part.verdict)
    write_text(PARTS.dump_json(shown, indent=1).decode(), state)
    in_order = [shown[name] for name in TITLES if name in shown]
    top: list[Block] = []
    sections = [Section("verdict", "Verdict", top)]
    for part in in_order:
        top += [*part.verdict, *part.warnings]
        folded = [table for table in part.tables if table.css_class == "folded"]
        blocks: list[Block] = [table for table in part.tables if table not in folded]
        blocks += [*part.figures, *folded]
        sections.append(Section(part.name, TITLES[part.name], blocks))
    scope = "Record of the treadmill and its force plates"
    return write_page(page, "Laboratory", scope, sections)


def recordings_table(folder: Path, file: StudyFile) -> Table:
    """Say which recordings of a laboratory are in its folder, in the order of making them."""
    treadmill, plates = file.treadmill, file.plates.calibration

    def finding(key: str, *names: str | None) -> list[Check]:
        files = [name for name in names if name]
        absent = [name for name in files if not (folder / name).is_file()]
        if files and not absent:
            return [("pass", "done", "; ".join(files))]
        return [("fail", "missing", "; ".join(absent) or f"to state as {key}")]

    beside_people = finding("treadmill.beside", *treadmill.beside)
    checks = finding("treadmill.check", treadmill.check)
    fitted = folder / (treadmill.calibration or "")
    if fitted.is_file():
        if fitted.suffix.lower() == ".json":  # it says what it was fitted to
            of_fit = from_json(read_text(fitted)).provenance.get(BESIDE, "")
            beside_people = [("pass", "done", of_fit)] if of_fit else finding("--beside of the fit")
        of_checks = "; ".join(read_checks(fitted)["recording"])
        checks = checks if treadmill.check or not of_checks else [("pass", "done", of_checks)]
    empty = finding("treadmill.calibration", treadmill.calibration)
    rows = [
        (f"Empty treadmill, signal {ADVISED_PLATFORM_SIGNAL}", empty),
        ("People beside an empty plate: walking, running, on the boards", beside_people),
        ("Known weights on the running belts, hbm plates", finding("plates.calibration", plates)),
        ("Empty treadmill on another day, same signal", checks),
    ]
    return Table("Recordings of the laboratory", ("Recording", "Finding"), rows, "answers")


def page_of_study(study: Study, folder: Path) -> str | None:
    """Give the address, from a folder, of the page beside a study's calibration or its plates'.

    None where neither has one.
    """
    files = study.file.treadmill.calibration, study.file.plates.calibration
    for path in (study.path(name).with_name(PAGE) for name in files if name):
        if path.is_file():
            try:
                return quote(Path(os.path.relpath(path, folder)).as_posix())
            except ValueError:  # on another drive
                return path.resolve().as_uri()
    return None


def frame_table(caption: str, frame: pd.DataFrame, digits: int, legend: str = "") -> Table:
    """Lay out rows of numbers and texts, numbers with so many digits after the point."""
    rows = [
        [written(cell, f".{digits}f") if isinstance(cell, float) else str(cell) for cell in row]
        for row in frame.itertuples(index=False)
    ]
    heads = [str(column).replace("_", " ") for column in frame.columns]
    return Table(caption, heads, rows, "folded", legend)


def calibration_part(
    calibration: Calibration,
    file: Path,
    empty: EmptyTreadmill,
    notes: Sequence[Note],
) -> Part:
    """Give the part of a calibration: for which trials it is fit, and what it leaves.

    Parameters
    ----------
    calibration, file
        The calibration and its file, beside which the checks are.
    empty
        The recording that it was fitted to.
    notes
        What was found in the fit.
    """
    tables = [component_table(calibration), frequency_table(empty)]
    tables.append(Table("Provenance", ("Item", "Finding"), provenance(notes), "folded"))
    verdict, drawn = calibration_in_use(calibration, file), _of_recording(calibration, empty)
    return replace(verdict, tables=tables, figures=drawn, warnings=warnings_of(notes))


def calibration_in_use(calibration: Calibration, file: Path) -> Part:
    """Give the part of a calibration without its recording: its verdict, by all checks."""
    verdict, of = calibration_verdict(calibration, file), file_digest(file)
    return Part("calibration", [verdict], of=of, warnings=warnings_of(calibration.notes))


def calibration_verdict(calibration: Calibration, file: Path) -> Table:
    """Say for which trials a calibration is fit, for how long, and what to do next."""
    rows = [row for of_plate in calibration.verdict.values() for row in of_plate]
    beyond = [row for row in rows if not row.passed]
    checks = read_checks(file)
    checks = checks[checks["calibration_sha256"] == file_digest(file)]
    failed = len(checks) > 0 and not bool(checks["valid"].iloc[-1])
    if not rows:
        answer: Check = ("check", "not judged", "file of an earlier version")
        todo = f"{NEW_FIT} again"
    elif calibration.loads_n:
        answer = ("fail", "not fit", "plates loaded or not zeroed")
        todo = f"empty and zero the plates, {NEW_FIT}"
    elif beyond:
        answer = ("fail", "not fit", f"{len(beyond)} of {len(rows)} components above the limit")
        todo = f"{NEW_FIT} again, or with more accelerometers"
    elif failed:
        answer = ("fail", "not valid any more", f"by {checks['recording'].iloc[-1]}")
        todo = f"zero the plates and check again; else {NEW_FIT}"
    else:
        answer = ("pass", "fit", f"{len(rows)} of {len(rows)} components within the limit")
        todo = f"hbm calibration check {file.name} RECORDING, each day of trials"
    answers: list[Sequence[str | Sequence[Check]]] = [
        ("Fit for trials", [answer]),
        ("Up to", limits_of(calibration)),
        ("Persons", _persons(rows)),
        ("For how long", _validity(checks)),
        ("Next", todo),
    ]
    return Table(f"Calibration {file.name}", ("Question", "Answer"), answers, "answers")


def limits_of(calibration: Calibration) -> str:
    """Say up to which sway, pitch, acceleration and belt speed a calibration is fit."""
    made, models = calibration.provenance, [*calibration.in_use.values()]
    texts = []
    if SWAY in made and PITCH in made:
        texts = [f"sway {1000 * float(made[SWAY]):.0f} mm", f"pitch {float(made[PITCH]):.1f}°"]
    mean = models[0].acceleration_mean
    most = np.max([models[0].acceleration_high - mean, mean - models[0].acceleration_low])
    texts.append(f"acceleration {most:.1f} m/s²")
    errors = [model.model_error for model in models if model.model_error is not None]
    speeds = [error.fastest_mps for error in errors if error.fastest_mps is not None]
    texts.append(f"belts {min(speeds):.2f} m/s" if speeds else "belt speed unknown")
    return ", ".join(texts)


def _persons(rows: Sequence[LeftOver]) -> str:
    """Say from which body mass on residuals rise by 5 % at most."""
    if not rows:
        return "–"
    lightest = lightest_kg(rows)
    return (
        "any body mass"
        if lightest < LIMITS.lightest_person
        else f"{lightest:.0f} kg and heavier: residuals rise by 5 % at most"
    )


def _validity(checks: pd.DataFrame) -> str:
    """Say on which days a calibration was valid."""
    if checks.empty:
        return "until a check fails; no check on another day yet"
    valid = checks[checks["valid"].astype(bool)]["day"]
    last = f", last on {valid.iloc[-1]}" if len(valid) else ""
    return (
        f"until a check fails; valid on {valid.nunique()} of {checks['day'].nunique()} days{last}"
    )


def component_table(calibration: Calibration) -> Table:
    """Give a row per plate and component: before, after, limit, share explained."""
    rows: list[Sequence[str | Sequence[Check]]] = []
    for plate, of_plate in calibration.verdict.items():
        details = ["" if row.verdict == "good" else row.verdict for row in of_plate]
        rows += zip(
            *([plate] * len(UNITS), WRENCH_COMPONENTS),
            with_units([row.excited for row in of_plate]),
            with_units([row.after for row in of_plate]),
            rated([row.left for row in of_plate], [not row.passed for row in of_plate], details),
            with_units([row.limit for row in of_plate]),
            [f"{100 * row.r_squared:.2f} %" for row in of_plate],
            strict=True,
        )
    return Table(
        "Empty plates before and after compensation, RMS",
        ("Plate", "Component", "Before", "After", "Below 6 Hz", "Limit", "Explained"),
        rows,
        "numbers",
        "Below 6 Hz: what remains at the frequencies of residuals, in all recordings of the fit; "
        "limit: raises residuals of a walking adult "
        f"of {PERSON_KG:g} kg by 5 %. Explained: R², low without harm where a component hardly "
        "moved. –: not known.",
    )


def with_units(values: Iterable[float] | None, form: str = ".2f") -> list[str]:
    """Write the six components of a plate; dashes where they are not known."""
    if values is None:
        return ["–"] * len(UNITS)
    return [f"{written(value, form)} {unit}" for value, unit in zip(values, UNITS, strict=True)]


def rated(
    values: Iterable[float],
    failed: Iterable[bool],
    details: Iterable[str] = ("",) * len(UNITS),
    form: str = ".2f",
) -> list[list[Check]]:
    """Write the six components of a plate, rated by whether each is beyond its limit."""
    cells = zip(with_units(values, form), failed, details, strict=True)
    return [[("fail" if beyond else "pass", text, detail)] for text, beyond, detail in cells]


def frequency_table(empty: EmptyTreadmill) -> Table:
    """Give belt speed, frequencies of rollers and base, and places of accelerometers."""
    rows = [("Belt speed", "–" if empty.belts_mps is None else f"{empty.belts_mps:.2f} m/s")]
    if empty.rollers_hz is not None and empty.belts_mps is not None:
        radius = empty.belts_mps / (2 * np.pi * empty.rollers_hz)
        rows.append(("Rollers", f"{empty.rollers_hz:.2f} Hz (radius {1000 * radius:.0f} mm)"))
    else:
        rows.append(("Rollers", "no line found"))
    base = ", ".join(f"{hz:.1f} Hz" for hz in empty.base_hz)
    rows.append(("Base", base or "no peak found"))
    rows += [(f"Accelerometer {name}", str(place)) for name, place in empty.places.items()]
    legend = "Places of accelerometers unknown: name markers on the platform (--platform-markers)."
    if empty.places:
        axis = "to the front" if empty.recording.axes else "as the file's axis (front: --axes)"
        legend = (
            "Accelerometers: by their readings; sway and pitch do not show the distance across. "
            f"Along the belts: positive {axis}."
        )
    title = f"Recording {empty.recording.source.name}"
    return Table(title, ("Item", "Value"), rows, "answers", legend)


def _of_recording(calibration: Calibration, empty: EmptyTreadmill) -> list[Drawn]:
    """Draw plates over time and spectra of a recording."""
    drawn, file = [], empty.recording.source.name
    for name, before in empty.before.items():
        figure = time_figure(before, before - empty.after[name], empty.rate_hz)
        caption = f"{name} in {file} over time, before and after compensation (its own axes)."
        drawn.append(Drawn(caption, drawing(figure, "png")))
    setup = next(iter(calibration.plates.values())).setup
    for name, spectrum in empty.spectra.items():
        figure = spectrum_figure(spectrum, empty, None if setup is None else setup.cutoff_hz)
        caption = f"Spectra of {name} in {file}, unfiltered; shaded: below the filter of trials."
        drawn.append(Drawn(caption, drawing(figure, "png")))
    return drawn


def check_part(
    calibration: Calibration,
    file: Path,
    check: str,
    checked: CalibrationCheck,
    empty: EmptyTreadmill | None,
) -> Part:
    """Give the part of a check, named by its recording and day, with all checks of the file."""
    answer = ("pass", "still valid") if checked.valid else ("fail", "not valid any more")
    reasons = [] if checked.valid else [note.text for note in checked.notes]
    worst = [f"{plate}: {fault}" for plate, one in checked.plates.items() for fault in one.faults]
    verdict = Table(
        f"Check of {file.name} by {check}",
        ("Question", "Answer"),
        [
            ("Calibration", [(*answer, "")]),
            ("Beyond limits", "; ".join(worst or reasons) or "none"),
        ],
        "answers",
    )
    tables, drawn = [history_table(read_checks(file))], list[Drawn]()
    if empty is not None:
        tables.insert(0, check_table(checked, empty))
        drawn = _of_recording(calibration, empty)
    return Part("check", [verdict], tables, drawn, file_digest(file), warnings_of(checked.notes))


def check_table(checked: CalibrationCheck, empty: EmptyTreadmill) -> Table:
    """Give what the calibration and a new fit leave on another day, and how the zeros changed."""
    rows: list[Sequence[str | Sequence[Check]]] = []
    for plate, one in checked.plates.items():
        rows += zip(
            *([plate] * len(UNITS), WRENCH_COMPONENTS),
            *(with_units(of[plate].std(axis=0)) for of in (empty.before, empty.after)),
            rated(one.left, one.leaves_much),
            *(with_units(one.left_by_new_fit), with_units(MAX_LEFT)),
            rated(one.zero_change, one.moved, form="+.2f"),
            with_units(MAX_ZERO_CHANGE),
            strict=True,
        )
    return Table(
        f"Plates in {empty.recording.source.name}, RMS about the mean",
        (
            *("Plate", "Component", "Before", "After", "Below 6 Hz", "By a new fit", "Limit"),
            *("Zero changed by", "Limit of zero"),
        ),
        rows,
        "numbers",
        "A calibration is valid where a new fit removes at most half of the limit more (in "
        "squares), and zeros have moved within their limit or three of their standard deviations.",
    )


def add_check(
    calibration: Path, recording: Path, checked: CalibrationCheck, day: str | None = None
) -> str:
    """Add a row to ``laboratory_checks.csv`` beside a calibration.

    Parameters
    ----------
    calibration, recording
        Their files. The row of an earlier check by this recording is replaced.
    checked
        The check.
    day
        Of the recording, YYYY-MM-DD; None for the day on which the file was last written.

    Returns
    -------
    str
        Recording and day.
    """
    if day is None:
        day = datetime.fromtimestamp(recording.stat().st_mtime, UTC).date().isoformat()
    row: dict[str, object] = {
        "day": day,
        "recording": recording.name,
        "valid": checked.valid,
        "calibration": calibration.name,
        "calibration_sha256": file_digest(calibration),
        "recording_sha256": file_digest(recording),
    }
    for plate, one in checked.plates.items():
        for k, name in enumerate(WRENCH_COMPONENTS):
            row[f"{plate} {name} left"] = one.left[k]
            row[f"{plate} {name} by new fit"] = one.left_by_new_fit[k]
            row[f"{plate} {name} zero change"] = one.zero_change[k]
    path = calibration.with_name(CHECKS)
    table = read_csv(path) if path.exists() else pd.DataFrame()
    if len(table):
        keys = ["calibration_sha256", "recording_sha256"]
        table = table[(table[keys] != [row[key] for key in keys]).any(axis=1)]
    table = pd.concat([table, pd.DataFrame([row])], ignore_index=True)
    write_csv(table.sort_values("day", kind="stable"), path)
    return f"{recording.name}, {day}"


def read_checks(calibration: Path) -> pd.DataFrame:
    """Give all checks of a calibration's file, a row each by day; empty where there are none."""
    path = calibration.with_name(CHECKS)
    columns = ["day", "recording", "valid", "calibration", "calibration_sha256"]
    table = read_csv(path) if path.exists() else pd.DataFrame(columns=columns)
    return table[table["calibration"] == calibration.name].reset_index(drop=True)


def history_table(checks: pd.DataFrame) -> Table:
    """Give day, recording and answer, a row per check; sizes are in the file."""
    valid, not_valid = [("pass", "valid", "")], [("fail", "not valid", "")]
    ratings = [valid if check else not_valid for check in checks["valid"]]
    rows = [*zip(checks["day"], checks["recording"], ratings, strict=True)]
    return Table(
        "Checks by day", ("Day", "Recording", "Calibration"), rows, legend=f"All numbers: {CHECKS}."
    )
