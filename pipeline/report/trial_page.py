"""The page of one trial: its residuals, warnings, joints, causes and provenance."""

import shlex
from collections.abc import Iterable, Iterator, Sequence
from contextlib import suppress
from pathlib import Path
from typing import TYPE_CHECKING, Final
from urllib.parse import quote

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from hbm.notes import provenance, warnings_of
from hbm.spatial import WRENCH_COMPONENTS
from hbm.spelling import join_names
from pipeline.config.study import Study
from pipeline.figures.joints import trial_figure
from pipeline.figures.residuals import component_figure, residual_figure
from pipeline.figures.style import PALETTE, drawing
from pipeline.io.recording import Plate
from pipeline.report.blocks import Block, Drawn, Section, Table, markup, write_page
from pipeline.report.trial_tables import (
    gait_table,
    result_tables,
    verdict_lines,
    worst_table,
)
from pipeline.report.trials import causes
from pipeline.run.program import program_digest
from pipeline.run.store import read_trial
from pipeline.trial.findings.finding import Finding
from pipeline.trial.findings.judge import LIMITS as JUDGE
from pipeline.trial.findings.words import note_of, row_of
from pipeline.trial.gait.cycles import mean_and_sd
from pipeline.trial.joints import joint_curves
from pipeline.trial.result import TrialResult
from pipeline.trial.study_files import read_study_file

if TYPE_CHECKING:
    from pipeline.budgets.explanation import Explanation

MAX_POINTS: Final = 3000
"""Of a drawn channel: finer ones are drawn as the extremes of as many intervals."""


def write_trial_page(
    result: TrialResult,
    path: str | Path,
    *,
    plates: Iterable[Plate] = (),
    explanation: "Explanation | None" = None,
    study: str = "",
    key: str = "",
    command: str = "",
    figure: str = "",
) -> Path:
    """Write the page of a trial.

    Parameters
    ----------
    result
        The trial, with its frames.
    path
        The page to write.
    plates
        As recorded: the channels of doubted ones are drawn.
    explanation
        Of the residuals; without it, the page names the command that finds their causes.
    study
        Address of the study's report, relative to the page; empty for a trial by itself.
    key
        A comment at the end of the page.
    command
        That finds the causes of the residuals; by default of the study or of the recording.
    figure
        Of the residuals as a source inside the page, where it has been drawn already.

    Returns
    -------
    Path
        The page.

    Raises
    ------
    OSError
        If it cannot be written.

    Examples
    --------
    >>> import pipeline
    >>> from pipeline.virtual_lab.protocol.walking_trial import simulate_trial
    >>> _ = simulate_trial("walk.c3d", duration_s=8.0)
    >>> walk = pipeline.read_c3d("walk.c3d")
    >>> result = pipeline.process_recording(walk, pipeline.Subject(sex="male"), pipeline.Settings())
    >>> write_trial_page(result, "trial.html", plates=walk.plates).name
    'trial.html'
    """
    path, of_study = Path(path), result.name
    name = str(of_study) if result.key else result.source.stem
    bands = explanation.budget.bands if explanation is not None else None
    of_causes: list[Block] = [] if explanation is None else [*causes(name, explanation)]
    viewer = ["hbm", "view", str(path.with_suffix(".parquet"))]
    if study:
        viewer = ["hbm", "view", str(path.parent.parent), "--subject", of_study.subject]
        viewer += ["--condition", of_study.condition]
        viewer += ["--recording", of_study.recording] * bool(of_study.recording)
    command = command or f"hbm explain {path.parent.parent if study else result.source.name}"
    settings = [(k, str(v)) for k, v in result.settings.model_dump().items() if v is not None]
    shown = figure or drawing(residual_figure(result, bands))
    blocks: dict[str, Sequence[Block]] = {
        "Residuals": [
            markup("headline.html", sentences=[*verdict_lines(result)]),
            Drawn(
                "Forces on the feet and pelvis residuals; lines: foot strikes, dotted: foot offs, "
                "shaded: counted.",
                shown,
            ),
            *worst_table(result, shlex.join(viewer)),
            *result_tables(result),
        ],
        "Warnings": [*_warnings(result), *_doubted(result, plates)],
        "Gait": [*gait_table(result), *_joints(result)],
        "Causes": of_causes or [f"Not explained yet: {command} finds the causes."],
        "Provenance": [
            Table("How the result was made", ("Item", "Finding"), provenance(result.notes)),
            Table("Settings", ("Setting", "Value"), settings),
            Table("Processed with", ("Package", "Version"), [*result.versions.items()]),
        ],
    }
    sections = (Section(title.lower(), title, below) for title, below in blocks.items())
    return write_page(path, name, result.title, sections, study, key)


def write_changed_page(
    trial: TrialResult, folder: Path, explanation: "Explanation | None", study: Study | None
) -> None:
    """Write a trial's page beside its result, unless it is of this result and program already.

    Its frames are read from there. Its commands name the folder as it is given.
    """
    name, page = trial.name, folder / "trials" / f"{trial.name.stem}.html"
    explained = explanation.key if explanation else ""
    key = f"<!-- {trial.key} {explained} {program_digest()} {quote(folder.as_posix())} -->"
    if page.is_file() and page.read_text(encoding="utf-8").endswith(key):
        return
    result, plates = read_trial(page.with_suffix(".parquet")), list[Plate]()
    if study is not None and name in study.trials and doubted_plates(result):
        planned = study.trial(name)
        with suppress(ValueError, OSError):  # the recording may be gone since
            static = study.subject(name.subject).static
            plates = [*read_study_file(study, str(planned.file), planned, static).plates]
    write_trial_page(
        result, page, plates=plates, explanation=explanation, study="../report.html", key=key
    )


def _joints(result: TrialResult) -> Iterator[Drawn]:
    """Draw mean and SD of the joints over the gait cycles of both sides, where there are any."""
    means = {
        variant: mean_and_sd(np.concatenate([*of_sides.values()]))
        for variant, of_sides in joint_curves(result).items()
        if of_sides
    }
    if means:
        text = (
            "Joints of the legs, mean ± SD over gait cycles of both sides, each from its foot "
            "strike. Internal moments by body mass, positive in the direction (+) in which the "
            "angle grows. Healthy: Pinzone et al. (2014)."
        )
        yield Drawn(text, drawing(trial_figure(means)))


def findings_table(result: TrialResult) -> Table | None:
    """Show what is wrong with plates, a row for each fault; None where nothing is."""
    if not result.findings:
        return None
    rows = [row_of(finding, result.plates, result.motion.time) for finding in result.findings]
    heads = (
        "Finding",
        "Size; where estimated, 95 % interval",
        "Evidence",
        "Correction changes",
        "What to do",
    )
    return Table(
        "Plates",
        heads,
        rows,
        "findings",
        "Evidence: raw samples, or twice the logarithm of the odds, by motion and feet, against no "
        f"fault; from {JUDGE.least_evidence:g} on it is named. Correction: RMS residual before → "
        "after, in all frames and in those that the size was not fitted to.",
    )


def _warnings(result: TrialResult) -> Iterator[Block]:
    """Give the findings of plates, and what else a person has to act on."""
    if table := findings_table(result):
        yield table
    shown = {note_of(f, result.plates, result.motion.time) for f in result.findings}
    others = [note for note in warnings_of(result.notes) if note not in shown]
    yield from others
    if not (table or others):
        yield "No warnings."


def doubted_plates(result: TrialResult) -> set[int]:
    """Give the numbers of plates that findings are of."""
    candidates = (one for finding in result.findings for one in (finding, *finding.rivals))
    return {number for finding in candidates for number in finding.plates}


def _doubted(result: TrialResult, plates: Iterable[Plate]) -> Iterator[Drawn]:
    """Draw the channels of doubted plates."""
    if doubted := [plate for plate in plates if plate.number in doubted_plates(result)]:
        names = join_names([f"plate {plate.number}" for plate in doubted])
        figure = plate_figure(doubted, result.findings)
        yield Drawn(f"Channels of {names}, as recorded", drawing(figure, "png"))


def plate_figure(plates: Sequence[Plate], findings: Sequence[Finding]) -> Figure:
    """Draw the six components of plates in their own axes, as recorded, over time.

    Dotted lines are where raw samples of a channel cannot be a load.
    """
    faults = [f for finding in findings for f in finding.channels if f.kind != "dead"]

    def draw(panel: Axes, k: int) -> None:
        for plate, colour in zip(plates, PALETTE, strict=False):
            time, low, high = _extremes(plate.time, plate.wrench_in_plate[:, k])
            label = f"plate {plate.number}"
            panel.fill_between(time, low, high, color=colour, lw=0.6, label=label)
            for fault in faults:
                if (fault.plate, fault.channel) == (plate.number, WRENCH_COMPONENTS[k]):
                    for begins_s, _ in fault.spans_s[:100]:  # more lines would fill the panel
                        panel.axvline(begins_s, color=colour, lw=0.8, ls=":", zorder=1)
        panel.set_xlabel("time (s)")

    return component_figure(WRENCH_COMPONENTS, draw)


def _extremes(time: np.ndarray, value: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Give time, minimum and maximum of at most `MAX_POINTS` intervals."""
    step = max(1, -(-len(time) // MAX_POINTS))
    starts = np.arange(0, len(time), step)
    low, high = (extreme.reduceat(value, starts) for extreme in (np.fmin, np.fmax))
    return time[starts], low, high
