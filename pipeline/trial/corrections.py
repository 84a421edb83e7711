"""Corrections of plates, each tried on the chain of the trial and judged on other frames."""

from collections.abc import Iterator, Sequence
from dataclasses import replace
from typing import Final

import numpy as np

from hbm.spatial import Array, Mask
from pipeline.io.recording import Plate
from pipeline.trial.chain import Chain
from pipeline.trial.findings.evidence import LOADED, Evidence
from pipeline.trial.findings.finding import MAX_WORSE, Correction, Finding
from pipeline.trial.findings.judge import Fitted, View, fit

MIN_MOVE_M: Final = 0.005
"""Shorter parts of a move are not typed."""
NEGLIGIBLE: Final = np.array([0.004, 0.004, 0.004, 0.001, 0.001, 0.001])
"""Change of an RMS that does not count, by body weight, and by body weight × stature: far below
that of healthy walks."""
MIN_FALL: Final = 0.03
"""Of the whitened residual: a correction that changes less is not worth typing."""
QUANTILE_95: Final = 1.96


def find_faults(chain: Chain) -> tuple[Finding, ...]:
    """Name what raw samples, then motion and feet show of the plates; try what corrects it."""
    evidence = chain.evidence
    findings, done = [*_of_samples(chain)], tuple[str, ...]()
    for first, *rivals in chain.judged:
        finding = _finding(first, evidence.plates)
        if rivals:
            others = tuple(_finding(each, evidence.plates) for each in rivals)
            findings.append(replace(finding, rivals=others))
            continue
        correction = try_fault(chain, first, done)
        findings.append(replace(finding, correction=correction))
        if correction is not None and correction.helps:
            done = (*done, *correction.mendings)
    return tuple(findings)


def _of_samples(chain: Chain) -> Iterator[Finding]:
    """Put the channels of a plate together in which raw samples show the same."""
    for plate, kind in dict.fromkeys((fault.plate, fault.kind) for fault in chain.raw_faults):
        channels = tuple(f for f in chain.raw_faults if (f.plate, f.kind) == (plate, kind))
        unwrap = [f"{plate}: unwrap {fault.channel}" for fault in channels]
        correction = try_mendings(chain, unwrap) if kind == "wraps" else None
        yield Finding(kind, (plate,), channels=channels, correction=correction)


def _finding(fitted: Fitted, plates: Sequence[Plate]) -> Finding:
    hypothesis, size = fitted.hypothesis, fitted.size.tolist()
    interval = QUANTILE_95 * np.sqrt(np.diag(fitted.covariance))
    numbers = tuple(plates[k].number for k in hypothesis.plates)
    what = hypothesis.kind, numbers, hypothesis.what
    return Finding(*what, tuple(size), tuple(interval.tolist()), fitted.evidence)


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
            moves = zip("xy", size, strict=True)
            return tuple(f"{number}: move {a} {m:.3f}" for a, m in moves if abs(m) > MIN_MOVE_M)
    return ()


def try_fault(chain: Chain, fitted: Fitted, done: tuple[str, ...]) -> Correction | None:
    """Correct a fault in all frames, and in the second half of them by the size in the first."""
    evidence, hypothesis = chain.evidence, fitted.hypothesis
    first = _first_half(evidence, hypothesis.plates)
    view = View.of(evidence, mass_is_stated=chain.mass.is_stated, frames=first)
    fitted_there = fit(view, hypothesis)
    if hypothesis.kind == "all_late":
        late = [
            (chain.settings.plate_delay_s or 0.0) + float(f.size[0]) for f in (fitted, fitted_there)
        ]
        return _tried(chain, [_later(chain, seconds) for seconds in late], first, (), late[0])
    every, there = (mendings_of(each, evidence.plates) for each in (fitted, fitted_there))
    if not every:
        return None
    chains = [chain.mended((*done, *mendings)) for mendings in (every, there)]
    before = chain.mended(done) if done else chain
    return _tried(before, chains, first, every, None)


def try_mendings(chain: Chain, mendings: Sequence[str]) -> Correction:
    """Try corrections whose size the residual did not give."""
    mended = chain.mended(mendings)
    return _tried(chain, [mended, mended], np.zeros(len(chain.time), bool), tuple(mendings), None)


def _later(chain: Chain, delay_s: float) -> Chain:
    settings = chain.settings.model_copy(update={"plate_delay_s": round(delay_s, 3)})
    return chain.changed(settings=settings)


def _first_half(evidence: Evidence, plates: Sequence[int]) -> Mask:
    """Give the first half of the frames in which some plates carry, and all before it, (T,)."""
    load = np.abs(evidence.wrenches[[*plates], :, 2]).max(axis=0) > LOADED * evidence.weight_n
    carried = load & evidence.carried
    if not carried.any():
        carried = evidence.carried if evidence.carried.any() else np.ones(len(load), bool)
    middle = np.flatnonzero(carried)[int(np.count_nonzero(carried)) // 2]
    return np.asarray(np.arange(len(load)) < middle)


def _tried(
    chain: Chain,
    corrected: Sequence[Chain],
    fitted_to: Mask,
    mendings: tuple[str, ...],
    plate_delay_s: float | None,
) -> Correction:
    """Compare residuals before and after; the second chain has sizes by the other frames alone."""
    counts = chain.evidence.carried
    for each in corrected:
        counts = counts & np.isfinite(each.residual).all(axis=1)
    others = counts & ~fitted_to
    before, after = _rms(chain.residual[counts]), _rms(corrected[0].residual[counts])
    held_out = _rms(chain.residual[others]), _rms(corrected[1].residual[others])
    whiten = np.sqrt(np.diag(chain.evidence.covariance))
    scale = chain.evidence.weight_n * np.repeat([1.0, chain.body.height_m], 3) * NEGLIGIBLE
    fall = 1 - np.linalg.norm(held_out[1] / whiten) / np.linalg.norm(held_out[0] / whiten)
    worse = (after > MAX_WORSE * before + scale) | (held_out[1] > MAX_WORSE * held_out[0] + scale)
    return Correction(
        mendings,
        plate_delay_s,
        before=tuple(before),
        after=tuple(after),
        held_out_before=tuple(held_out[0]),
        held_out_after=tuple(held_out[1]),
        helps=bool(fall > MIN_FALL and not worse.any()),
    )


def _rms(residual: Array) -> Array:
    if not len(residual):
        return np.zeros(6)
    return np.asarray(np.sqrt(np.mean(np.square(residual), axis=0)))
