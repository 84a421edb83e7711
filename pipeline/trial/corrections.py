"""Corrections of plates, each tried on the chain of the trial and judged on other frames."""

from collections.abc import Iterator, Sequence
from dataclasses import replace
from typing import Final

import numpy as np

from hbm.numbers import read_numbers
from hbm.spatial import WRENCH_COMPONENTS, Array, Mask
from pipeline.io.recording import Plate
from pipeline.trial.chain import Chain
from pipeline.trial.findings.drift import following
from pipeline.trial.findings.evidence import LIMITS as EVIDENCE
from pipeline.trial.findings.evidence import Evidence
from pipeline.trial.findings.finding import LIMITS as FINDING
from pipeline.trial.findings.finding import Correction, Finding
from pipeline.trial.findings.judge import LIMITS as JUDGE
from pipeline.trial.findings.judge import Fitted, View, fit
from pipeline.trial.findings.zeros import wrong_zeros

LIMITS: Final = read_numbers("pipeline.trial", "thresholds.toml", "corrections")


def find_faults(chain: Chain) -> tuple[Finding, ...]:
    """Name what raw samples, then motion and feet show of the plates, one fault after the other.

    Each is corrected on the chain before the next one is looked for; what cannot be told from
    others, or cannot be corrected, ends the search.
    """
    # what raw samples show is certain, whatever motion and feet say
    findings = [*_of_samples(chain)]
    tried = (finding.correction for finding in findings)
    done = tuple(mending for one in tried if one and one.helps for mending in one.mendings)
    if done:  # what overflows is judged once that is undone
        chain = chain.mended(done)
    if drifts := [*_of_drifts(chain)]:
        # together: two that drift may cancel in the sum of all plates
        mendings = [f"{number}: drift" for finding in drifts for number in finding.plates]
        mended = chain.mended(mendings)
        correction = _tried_as_measured(chain, mended, mendings)
        findings += [replace(finding, correction=correction) for finding in drifts]
        # other faults are judged without it, however little it adds to the residual
        done, chain = (*done, *mendings), mended
    findings += _of_zeros(chain)
    # then the likeliest fault, corrected before the next one is looked for
    most = len(findings) + LIMITS.most_faults
    while len(findings) < most and chain.judged:
        first, *rivals = chain.judged
        plates = chain.evidence.plates
        finding = finding_of(first, plates)
        # the same fault again: its correction did not remove it
        same = (finding.kind, finding.plates, finding.component)
        if same in [(f.kind, f.plates, f.component) for f in findings]:
            break
        # a fault that cannot be told from others is not corrected, and hides what is behind it
        if rivals:
            others = tuple(finding_of(rival, plates) for rival in rivals)
            return (*findings, replace(finding, rivals=others))
        corrected = _try_fault(chain, first)
        if corrected is None:
            return (*findings, finding)
        correction, mended = corrected
        # a fault that is as sure as this is named though its correction does not help
        if not correction.helps and first.evidence < 2 * JUDGE.least_evidence:
            break
        # what is typed for one fault is typed with what corrects those before it
        done = (*done, *correction.mendings)
        findings.append(replace(finding, correction=replace(correction, mendings=done)))
        if not correction.helps:
            break
        chain = mended
    return tuple(findings)


def _of_samples(chain: Chain) -> Iterator[Finding]:
    """Put the channels of a plate together in which raw samples show the same."""
    for plate, kind in dict.fromkeys((fault.plate, fault.kind) for fault in chain.raw_faults):
        channels = tuple(f for f in chain.raw_faults if (f.plate, f.kind) == (plate, kind))
        unwrap = [f"{plate}: unwrap {fault.channel}" for fault in channels]
        correction = try_mendings(chain, unwrap, certain=True) if kind == "wraps" else None
        yield Finding(kind, (plate,), channels=channels, correction=correction)


def _of_drifts(chain: Chain) -> Iterator[Finding]:
    """Give plates whose zeros drift, and are not followed."""
    for plate, zero in zip(chain.trial.plates, chain.zeros, strict=True):
        if zero is not None and zero.drifts.any() and plate.number not in following(chain.trial):
            which = np.flatnonzero(zero.drifts)
            names = ", ".join(WRENCH_COMPONENTS[k] for k in which)
            sizes = tuple(zero.change[which].tolist()), tuple(zero.interval[which].tolist())
            yield Finding("drift", (plate.number,), names, *sizes, span_s=zero.span_s)


def _of_zeros(chain: Chain) -> Iterator[Finding]:
    """Give plates that are not zero without load, and what subtracting it does.

    A zero that drifts, or is followed, is no constant.
    """
    plates, followed = chain.trial.plates, following(chain.trial)
    # what changes over the trial is corrected as a drift
    drifts = [zero is not None and zero.drifts.any() for zero in chain.zeros]
    changes = [d or plate.number in followed for d, plate in zip(drifts, plates, strict=True)]
    constant = [None if c else zero for c, zero in zip(changes, chain.unloaded, strict=True)]
    wrong = wrong_zeros(plates, constant)
    if wrong is not None:
        finding, mendings = wrong
        correction = try_mendings(chain, mendings) if mendings else None
        yield replace(finding, correction=correction)


def finding_of(fitted: Fitted, plates: Sequence[Plate]) -> Finding:
    """Give a fault of plates with their numbers and 95 % intervals."""
    hypothesis, size = fitted.hypothesis, fitted.size.tolist()
    numbers = tuple(plates[k].number for k in hypothesis.plates)
    what = hypothesis.kind, numbers, hypothesis.what
    return Finding(*what, tuple(size), tuple(fitted.interval.tolist()), fitted.evidence)


def mendings_of(fitted: Fitted, plates: Sequence[Plate]) -> tuple[str, ...]:
    """Give what has to be typed to undo a fault; nothing where no mending does."""
    hypothesis, size = fitted.hypothesis, fitted.size
    number, *others = (plates[k].number for k in hypothesis.plates)
    match hypothesis.kind:
        case "gain":
            return (f"{number}: gain {hypothesis.what} {1 + size[0]:.3f}",)
        case "reversed":
            return (f"{number}: reverse {hypothesis.what}",)
        case "turned":
            return (f"{number}: turn {hypothesis.what}",)
        case "exchanged":
            return (f"{number}: exchange {others[0]}",)
        case "moved":
            typed = zip("xy", size, _typed_moves(fitted), strict=True)
            return tuple(f"{number}: move {axis} {m:.3f}" for axis, m, sure in typed if sure)
    return ()


def _typed_moves(fitted: Fitted) -> Mask:
    """Say which parts of a move are long and sure enough to be typed, (2,)."""
    return np.asarray(np.abs(fitted.size) > np.maximum(LIMITS.shortest_move, fitted.interval))


def _try_fault(chain: Chain, fitted: Fitted) -> tuple[Correction, Chain] | None:
    """Correct a fault in all frames, and in the second half of them by the size in the first.

    With the chain that is corrected in all frames; None where nothing that can be typed does it.
    """
    evidence, hypothesis = chain.evidence, fitted.hypothesis
    first = _first_half(evidence, hypothesis.plates)
    # the size from the first half alone, to be judged in the second half
    view = View.of(evidence, mass_is_stated=chain.mass.is_stated, frames=first)
    in_half = fit(view, hypothesis)
    if hypothesis.kind == "moved":  # along the axes that are typed
        size = np.where(_typed_moves(fitted), in_half.size, 0.0)
        in_half = in_half._replace(size=size, covariance=0 * in_half.covariance)
    sizes = fitted, in_half
    if hypothesis.kind == "all_late":
        if chain.inputs.laboratory.plates is not None:
            return None  # their calibration has the delay
        # what is stated already, and what is missing; a delay is typed in whole milliseconds
        before_s = chain.settings.plate_delay_s or 0.0
        late_s = [round(before_s + float(fitted_size.size[0]), 3) for fitted_size in sizes]
        chains = [_later(chain, delay_s) for delay_s in late_s]
        return _tried(chain, chains, first, (), late_s[0]), chains[0]
    in_all, there = (mendings_of(one, evidence.plates) for one in sizes)
    if not in_all:
        return None
    mended = chain.mended(in_all)
    # a fault without a size is corrected alike in every part
    in_others = mended if there == in_all else chain.mended(there)
    return _tried(chain, [mended, in_others], first, in_all, None), mended


def try_mendings(chain: Chain, mendings: Sequence[str], *, certain: bool = False) -> Correction:
    """Try corrections whose size the residual did not give.

    Those of a fault that is certain help wherever they make no axis larger.
    """
    mended, fitted_to = chain.mended(mendings), np.zeros(len(chain.time), bool)
    return _tried(chain, [mended, mended], fitted_to, tuple(mendings), None, certain=certain)


def _tried_as_measured(chain: Chain, mended: Chain, mendings: Sequence[str]) -> Correction:
    """Compare residuals before and after what unloaded plates show is corrected.

    It helps wherever the whole residual is smaller: an axis may have been small because the fault
    cancels something else in it.
    """
    no_frame = np.zeros(len(chain.time), bool)
    return _tried(chain, [mended, mended], no_frame, tuple(mendings), None, any_axis=True)


def _later(chain: Chain, delay_s: float) -> Chain:
    settings = chain.settings.model_copy(update={"plate_delay_s": delay_s})
    return chain.changed(settings=settings)


def _first_half(evidence: Evidence, plates: Sequence[int]) -> Mask:
    """Give the first half of the frames in which some plates are loaded, and before, (T,)."""
    # load on the plates in question: elsewhere a correction changes nothing
    load = np.abs(np.nan_to_num(evidence.wrenches[[*plates], :, 2])).max(axis=0)
    loaded = load > EVIDENCE.loaded * evidence.weight_n
    counted = loaded & evidence.carried
    frames = np.flatnonzero(
        counted if np.count_nonzero(counted) >= LIMITS.fewest_counted else loaded
    )
    middle = frames[len(frames) // 2] if len(frames) else len(load) // 2
    return np.asarray(np.arange(len(load)) < middle)


def _tried(
    chain: Chain,
    corrected: Sequence[Chain],
    fitted_to: Mask,
    mendings: tuple[str, ...],
    plate_delay_s: float | None,
    *,
    certain: bool = False,
    any_axis: bool = False,
) -> Correction:
    """Compare residuals before and after; the second chain has sizes by the other frames alone.

    What is certain need not lower them, and with ``any_axis`` an axis may grow.
    """
    least_fall = 0.0 if certain else LIMITS.least_fall
    most = np.inf if any_axis else FINDING.largest_growth
    # frames that count once it is corrected: some faults leave frames out
    counts = corrected[0].counts & np.isfinite(chain.residual).all(axis=1)
    for mended in corrected:
        counts = counts & np.isfinite(mended.residual).all(axis=1)
    # frames to which no size was fitted
    others = counts & ~fitted_to
    before, after = _rms(chain.residual[counts]), _rms(corrected[0].residual[counts])
    held_out = _rms(chain.residual[others]), _rms(corrected[1].residual[others])
    # in standard deviations of healthy residuals, so that newtons and newton metres compare
    deviation = np.sqrt(np.diag(chain.evidence.covariance))
    there, corrected_there = (np.linalg.norm(rms / deviation) for rms in held_out)
    # an axis is worse if it grows by a fraction and beyond noise, here or there
    worse = after > most * before + LIMITS.noise * deviation
    worse |= held_out[1] > most * held_out[0] + LIMITS.noise_held_out * deviation
    return Correction(
        mendings,
        plate_delay_s,
        before=tuple(before),
        after=tuple(after),
        held_out_before=tuple(held_out[0]),
        held_out_after=tuple(held_out[1]),
        helps=bool(
            counts.any() and corrected_there <= (1 - least_fall) * there and not worse.any()
        ),
    )


def _rms(residual: Array) -> Array:
    if not len(residual):
        return np.zeros(6)
    return np.asarray(np.sqrt(np.mean(np.square(residual), axis=0)))
