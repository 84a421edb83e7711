"""The page of a laboratory, ``laboratory.html``: calibration, checks, plates, calibration signals.

Each command writes its own part and leaves the parts of the others in the folder as they are.
"""

import os
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path
from typing import Final, Literal, NamedTuple
from urllib.parse import quote

import matplotlib as mpl
import numpy as np
import pandas as pd
from matplotlib.figure import Figure

from compensation import Calibration
from compensation.inertia.quality import (
    MAX_GAIN,
    MAX_LEFT,
    MAX_ZERO_CHANGE,
    PERSON_KG,
    UNITS,
    LeftOver,
    lightest_kg,
)
from compensation.inertia.sensors import MAX_EXCESS_SHARE
from hbm.spatial import WRENCH_COMPONENTS, Array
from pipeline.config.study import Study
from pipeline.figures.style import STYLE
from pipeline.io.input_file import read_text
from pipeline.io.write import read_csv, write_csv, write_text
from pipeline.report.blocks import TEMPLATES, Check, Table, drawing
from pipeline.report.empty_treadmill import (
    PITCH,
    SWAY,
    EmptyTreadmill,
    Sources,
    plan_figure,
    range_figure,
    spectrum_figure,
    time_figure,
)
from pipeline.run.job import file_digest
from pipeline.trial.ground.calibrations import CalibrationCheck

PAGE: Final = "laboratory.html"
CHECKS: Final = "laboratory_checks.csv"
PartName = Literal["calibration", "check", "plates", "ranking"]
TITLES: Final[Mapping[PartName, str]] = {
    "calibration": "Calibration of the moving treadmill",
    "check": "Checks on other days",
    "plates": "Plates under known weights",
    "ranking": "Ranking of calibration signals",
}
KEPT: Final = re.compile(
    r"<!-- (verdict|details) of (\w+) (\w*) -->\n(.*?)<!-- end -->\n", re.DOTALL
)
CHILD_KG: Final = 20.0
"""Lighter persons hardly walk on treadmills."""
BEYOND: Final = "study_beyond_range"
"""In a calibration's provenance: conditions of the study beyond its range."""
NEW_FIT: Final = "record the empty treadmill, hbm calibration fit"


class Drawn(NamedTuple):
    """A figure with its caption; one of many points is stored as pixels."""

    caption: str
    figure: Figure
    many_points: bool = False


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
    keep
        Whether tables and figures that the page has of this part stay, in place of these.
    """

    name: PartName
    verdict: Sequence[Table]
    tables: Sequence[Table] = ()
    figures: Sequence[Drawn] = ()
    of: str = ""
    keep: bool = False


def write_page(folder: Path, *parts: Part) -> Path:
    """Write parts into the page of a folder.

    Parameters
    ----------
    folder
        Of the page.
    *parts
        They replace those of their names. Parts of another calibration go.

    Returns
    -------
    Path
        ``laboratory.html``.
    """
    path, kept = folder / PAGE, dict[tuple[str, str], tuple[str, str]]()
    for what, name, of, text in KEPT.findall(read_text(path) if path.exists() else ""):
        kept[what, name] = of, text.rstrip()
    given = {part.name: part for part in parts}
    calibration = next((part.of for part in parts if part.of), "")
    shown = []
    for name, title in TITLES.items():
        part = given.get(name)
        known = {what: kept.get((what, name), ("", "")) for what in ("verdict", "details")}
        if calibration and known["details"][0] not in ("", calibration):
            known = dict.fromkeys(known, ("", ""))
        if part is None and not known["verdict"][1]:
            continue
        keeps = part is None or part.keep
        shown.append(
            {
                "name": name,
                "title": title,
                "of": part.of if part else known["verdict"][0],
                "verdict": part.verdict if part else (),
                "tables": part.tables if part else (),
                "drawn": [
                    (one.caption, drawing(one.figure, ".png" if one.many_points else ".svg"))
                    for one in (part.figures if part else ())
                ],
                "kept_verdict": "" if part else known["verdict"][1],
                "kept_details": known["details"][1] if keeps else "",
            }
        )
    page = TEMPLATES.get_template("laboratory.html").render(
        name="Laboratory", scope="Record of the treadmill and its force plates", parts=shown
    )
    write_text(page, path)
    return path


def page_of_study(study: Study, folder: Path) -> str | None:
    """Give the address, from a folder, of the page beside a study's calibration or its plates'.

    None where neither has one.
    """
    stated = study.file.treadmill.calibration, study.file.plates.calibration
    for path in (study.path(name).with_name(PAGE) for name in stated if name):
        if path.is_file():
            try:
                return quote(Path(os.path.relpath(path, folder)).as_posix())
            except ValueError:  # on another drive
                return path.resolve().as_uri()
    return None


def frame_table(
    caption: str, frame: pd.DataFrame, digits: int, legend: str = "", css_class: str = "folded"
) -> Table:
    """Lay out rows of numbers and texts, numbers with so many digits after the point."""
    rows = [
        [f"{cell:.{digits}f}" if isinstance(cell, float) else str(cell) for cell in row]
        for row in frame.itertuples(index=False)
    ]
    heads = [str(column).replace("_", " ") for column in frame.columns]
    return Table(caption, heads, rows, css_class, legend)


def calibration_part(
    calibration: Calibration,
    file: Path,
    empty: EmptyTreadmill | None = None,
    others: Mapping[str, tuple[Array, Array]] | None = None,
) -> Part:
    """Give the part of a calibration: for which trials it is fit, and what it leaves.

    Parameters
    ----------
    calibration, file
        The calibration and its file, beside which the checks are.
    empty
        The recording that it was fitted to; None to keep its tables and figures.
    others
        Of the study's trials: label -> lowest and highest acceleration of the channels, (k,)
        [m/s²] each.
    """
    verdict, of = calibration_verdict(calibration, file), file_digest(file)
    if empty is None:
        return Part("calibration", [verdict], [component_table(calibration, {})], of=of, keep=True)
    drawn = _of_recording(calibration, empty)
    tables = [component_table(calibration, empty.sources), frequency_table(empty)]
    if others:
        tables.append(range_table(calibration, others))
    text = "Range of the calibration" + (" and of the trials of the study." if others else ".")
    drawn.append(Drawn(text, range_figure(calibration, others or {})))
    return Part("calibration", [verdict], tables, drawn, of)


def beyond_range(calibration: Calibration, others: Mapping[str, tuple[Array, Array]]) -> str:
    """Name the conditions of a study that accelerate the treadmill more than its calibration."""
    rows = range_table(calibration, others).rows
    return ", ".join(str(row[0]) for row in rows if row[-1][0][0] != "pass")


def calibration_verdict(calibration: Calibration, file: Path) -> Table:
    """Say for which trials a calibration is fit, for how long, and what to do next."""
    rows = [row for of_plate in calibration.verdict.values() for row in of_plate]
    beyond = [row for row in rows if not row.passed]
    codes = {note.code for note in calibration.notes}
    checks = read_checks(file)
    checks = checks[checks["calibration_sha256"] == file_digest(file)]
    failed = len(checks) > 0 and not bool(checks["valid"].iloc[-1])
    if not rows:
        answer: Check = ("check", "not judged", "file of an earlier version")
        todo = f"{NEW_FIT} again"
    elif "calibration_loaded" in codes:
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
    if BEYOND in calibration.provenance:
        far = calibration.provenance[BEYOND]
        within: Check = ("pass", "within its range", "")
        too_far: Check = ("check", f"beyond its range: {far}", "")
        answers.append(("Study", [too_far if far else within]))
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
    errors = [model.model_error for model in models]
    speeds = [error.fastest_mps for error in errors if error is not None]
    known = [speed for speed in speeds if speed is not None]
    texts.append(f"belts {min(known):.2f} m/s" if known else "belt speed unknown")
    return ", ".join(texts)


def _persons(rows: Sequence[LeftOver]) -> str:
    """Say from which body mass on residuals rise by 5 % at most."""
    if not rows:
        return "–"
    lightest = lightest_kg(rows)
    return "any body mass" if lightest < CHILD_KG else f"{lightest:.0f} kg and heavier"


def _validity(checks: pd.DataFrame) -> str:
    """Say on which days a calibration was valid."""
    if checks.empty:
        return "until a check fails; no check on another day yet"
    valid = checks[checks["valid"].astype(bool)]["day"]
    last = f", last on {valid.iloc[-1]}" if len(valid) else ""
    return (
        f"until a check fails; valid on {valid.nunique()} of {checks['day'].nunique()} days{last}"
    )


def component_table(calibration: Calibration, sources: Mapping[str, Sources]) -> Table:
    """Give a row per plate and component: before, after, limit, share explained, sources."""
    rows: list[list[str | Sequence[Check]]] = []
    for plate, of_plate in calibration.verdict.items():
        of = sources.get(plate, Sources())
        for k, row in enumerate(of_plate):
            numbers = (row.excited, row.after)
            parts = (of.base, of.rollers, of.other, of.people)
            rows.append(
                [
                    plate,
                    row.component,
                    *(f"{number:.2f} {row.unit}" for number in numbers),
                    [_rated(row)],
                    f"{row.limit:.2f} {row.unit}",
                    f"{100 * row.r_squared:.2f} %",
                    *("–" if part is None else f"{part[k]:.2f} {row.unit}" for part in parts),
                ]
            )
    return Table(
        "Empty plates before and after compensation, RMS",
        (
            *("Plate", "Component", "Before", "After", "Below 6 Hz", "Limit", "Explained"),
            *("Base", "Rollers", "Other", "People"),
        ),
        rows,
        "numbers",
        "Below 6 Hz: what remains at the frequencies of residuals, in all recordings of the fit; "
        "limit: raises residuals of a walking adult "
        f"of {PERSON_KG:g} kg by 5 %. Explained: R², low without harm where a component hardly "
        "moved. By source, of the empty recording: base, expected of the platform's motion; "
        "rollers, the line at their frequency; other, the rest in squares. People: expected of "
        "the platform's motion in recordings of people. –: not known.",
    )


def _rated(row: LeftOver) -> Check:
    words = {"above limit": "above the limit", "hardly moved": "hardly moved"}
    return (
        "pass" if row.passed else "fail",
        f"{row.left:.2f} {row.unit}",
        words.get(row.verdict, ""),
    )


def range_table(calibration: Calibration, others: Mapping[str, tuple[Array, Array]]) -> Table:
    """Compare the range of other recordings with that of a calibration, channel by channel.

    Of each the channel that is farthest beyond, or nearest to the end of the range.
    """
    model = next(iter(calibration.plates.values()))
    names = [f"{sensor} {axis}" for sensor in model.sensors for axis in "xyz"]
    low, high = model.acceleration_low, model.acceleration_high
    rows: list[list[str | Sequence[Check]]] = []
    for label, (least, most) in others.items():
        excess = np.maximum(low - least, most - high) / (high - low)
        k = int(np.argmax(excess))
        beyond = excess[k] > MAX_EXCESS_SHARE
        rated: Check = ("check", "beyond", "") if beyond else ("pass", "within", "")
        ranges = (f"{a[k]:.1f} to {b[k]:.1f} m/s²" for a, b in ((least, most), (low, high)))
        rows.append([label, names[k], *ranges, [rated]])
    heads = ("Trials", "Channel", "Range", "Calibration", "Range of the calibration")
    return Table("Accelerations of the study's trials", heads, rows)


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
    rows += [
        (f"Accelerometer {name}", f"{place.along:+.2f} m along the belts, {place.up:+.2f} m up")
        for name, place in empty.places.items()
    ]
    legend = "Along the belts: positive to the front."
    if empty.recording.stated.axes is None:
        legend = "Along the belts: which end is positive is not known without --axes."
    title = f"Recording {empty.recording.source.name}"
    return Table(title, ("Item", "Value"), rows, "answers", legend if empty.places else "")


def _of_recording(calibration: Calibration, empty: EmptyTreadmill) -> list[Drawn]:
    """Draw plates over time, spectra and plan of a recording."""
    drawn, file = [], empty.recording.source.name
    axes = "plate's own axes"
    for name, before in empty.before.items():
        figure = time_figure(before, before - empty.after[name], empty.rate_hz)
        caption = f"{name} in {file} over time, before and after compensation ({axes})."
        drawn.append(Drawn(caption, figure, many_points=True))
    setup = next(iter(calibration.plates.values())).setup
    cutoff_hz = None if setup is None else setup.cutoff_hz
    for name, spectrum in empty.spectra.items():
        figure = spectrum_figure(spectrum, empty, cutoff_hz)
        caption = f"Spectra of {name} in {file}, unfiltered; shaded: below the filter of trials."
        drawn.append(Drawn(caption, figure, many_points=True))
    places = (
        "Accelerometers: distance along the belts (dashed) and height by their readings; sway and "
        "pitch do not show the distance across. Front and rear: as the axes are given (--axes)."
        if empty.places
        else "Places of accelerometers unknown: name markers on the platform (--platform-markers)."
    )
    text = f"Plan from above: plates and markers as {file} states. {places}"
    return [*drawn, Drawn(text, plan_figure(empty))]


def check_part(
    calibration: Calibration,
    file: Path,
    check: str,
    found: CalibrationCheck,
    empty: EmptyTreadmill | None,
) -> Part:
    """Give the part of a check, named by its recording and day, with all checks of the file."""
    answer = ("pass", "still valid") if found.valid else ("fail", "not valid any more")
    reasons = [] if found.valid else [note.text for note in found.notes]
    worst = [f"{plate}: {fault}" for plate, one in found.plates.items() for fault in one.faults]
    verdict = Table(
        f"Check of {file.name} by {check}",
        ("Question", "Answer"),
        [
            ("Calibration", [(*answer, "")]),
            ("Beyond limits", "; ".join(worst or reasons) or "none"),
        ],
        "answers",
    )
    tables = [history_table(read_checks(file))]
    drawn = [
        Drawn(
            "Checks over days, worst component of each plate. Cross: not valid; hollow: of an "
            "earlier calibration.",
            history_figure(file),
        )
    ]
    if empty is not None:
        tables.insert(0, check_table(found, empty))
        drawn += _of_recording(calibration, empty)
        seen = {empty.recording.source.name: (empty.low, empty.high)}
        drawn.append(Drawn("Range of calibration and check.", range_figure(calibration, seen)))
    return Part("check", [verdict], tables, drawn, file_digest(file))


def check_table(found: CalibrationCheck, empty: EmptyTreadmill) -> Table:
    """Give what the calibration and a new fit leave on another day, and how the zeros changed."""
    rows: list[list[str | Sequence[Check]]] = []
    for plate, one in found.plates.items():
        before = empty.before[plate].std(axis=0)
        after = np.sqrt(
            np.mean((empty.after[plate] - empty.after[plate].mean(axis=0)) ** 2, axis=0)
        )
        for k, (name, unit) in enumerate(zip(WRENCH_COMPONENTS, UNITS, strict=True)):
            starts = [fault.split()[0] for fault in one.faults], [f.split()[:3] for f in one.faults]
            left: Check = (
                "fail" if name in starts[0] else "pass",
                f"{one.left[k]:.2f} {unit}",
                "",
            )
            zero: Check = (
                "fail" if ["zero", "of", name] in starts[1] else "pass",
                f"{one.zero_change[k]:+.2f} {unit}",
                "",
            )
            rows.append(
                [
                    plate,
                    name,
                    f"{before[k]:.2f} {unit}",
                    f"{after[k]:.2f} {unit}",
                    [left],
                    f"{one.left_by_new_fit[k]:.2f} {unit}",
                    f"{MAX_LEFT[k]:.2f} {unit}",
                    [zero],
                    f"{MAX_ZERO_CHANGE[k]:.2f} {unit}",
                ]
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
        "squares), and zeros have moved no more than zeros do.",
    )


def add_check(
    calibration: Path, recording: Path, found: CalibrationCheck, day: str | None = None
) -> str:
    """Add a row to ``laboratory_checks.csv`` beside a calibration.

    Parameters
    ----------
    calibration, recording
        Their files. The row of an earlier check by this recording is replaced.
    found
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
        "valid": found.valid,
        "calibration": calibration.name,
        "calibration_sha256": file_digest(calibration),
        "recording_sha256": file_digest(recording),
    }
    for plate, one in found.plates.items():
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
    if not path.exists():
        columns = ["day", "recording", "valid", "calibration", "calibration_sha256"]
        return pd.DataFrame(columns=columns)
    table = read_csv(path)
    return table[table["calibration"] == calibration.name].reset_index(drop=True)


def history_table(checks: pd.DataFrame) -> Table:
    """Give day, recording and largest values by their limits, a row per check."""
    rows: list[list[str | Sequence[Check]]] = []
    for _, check in checks.iterrows():
        rating: Check = ("pass", "valid", "") if check["valid"] else ("fail", "not valid", "")
        cells = []
        for what, limits in (("left", MAX_LEFT), ("zero change", MAX_ZERO_CHANGE)):
            columns = [c for c in checks.columns if c.endswith(what) and not pd.isna(check[c])]
            components = [
                WRENCH_COMPONENTS.index(c.split()[-1 - len(what.split())]) for c in columns
            ]
            sizes = [abs(check[c]) / limits[k] for c, k in zip(columns, components, strict=True)]
            worst = int(np.argmax(sizes)) if sizes else None
            cells.append(
                "–"
                if worst is None
                else f"{columns[worst].removesuffix(what)}{check[columns[worst]]:.2f} "
                f"{UNITS[components[worst]]}"
            )
        rows.append([str(check["day"]), str(check["recording"]), [rating], *cells])
    heads = ("Day", "Recording", "Calibration", "Largest RMS below 6 Hz", "Largest change of zero")
    return Table("Checks by day; largest: in relation to the limit", heads, rows)


def history_figure(calibration: Path) -> Figure:
    """Draw each check of a calibration's file over days, the worst component of each plate."""
    checks, digest = read_checks(calibration), file_digest(calibration)
    days = pd.to_datetime(checks["day"]).to_numpy()
    plates = list(dict.fromkeys(c.rsplit(" ", 2)[0] for c in checks.columns if c.endswith(" left")))
    own = (checks["calibration_sha256"] == digest).to_numpy()
    valid = checks["valid"].to_numpy(bool)
    with mpl.rc_context(STYLE):
        figure = Figure(figsize=(9, 3.2), layout="constrained")
        panels = figure.subplots(1, 2)
        titles = "removed by a new fit / allowed", "largest change of zero / limit"
        for panel, title, moved in zip(panels, titles, (False, True), strict=True):
            for n, plate in enumerate(plates):
                left, new, zero = (
                    checks[[f"{plate} {name} {what}" for name in WRENCH_COMPONENTS]].to_numpy(float)
                    for what in ("left", "by new fit", "zero change")
                )
                removed = np.sqrt(np.maximum(left**2 - new**2, 0)) / (MAX_GAIN * MAX_LEFT)
                worst = (np.abs(zero) / MAX_ZERO_CHANGE if moved else removed).max(axis=1)
                panel.plot(days, worst, color=f"C{n}", lw=1, label=plate)
                for marker, of_kind in (("o", valid), ("X", ~valid)):
                    for shown, face in ((own & of_kind, f"C{n}"), (~own & of_kind, "none")):
                        look = {"color": f"C{n}", "mfc": face, "ms": 7, "ls": "none"}
                        panel.plot(days[shown], worst[shown], marker=marker, **look)
            panel.axhline(1, color="black", ls="--", lw=0.9)
            panel.set_ylim(bottom=0)
            panel.set_title(title, loc="left")
            panel.set_xticks(np.unique(days))
            panel.set_xticklabels(
                [str(day)[:10] for day in np.unique(days)], rotation=30, ha="right"
            )
        if plates:
            panels[0].legend(frameon=False)
    return figure
