"""What is said of a live session when it has ended."""

from pathlib import Path

from pipeline.live.frames.chain import LiveChain
from pipeline.live.monitor import Monitor, in_words
from pipeline.live.recording import RESULTS, STREAMS, Recorder
from pipeline.live.session import Session


def summary(
    chain: LiveChain,
    monitor: Monitor,
    session: Session,
    recorder: Recorder,
    folder: Path,
) -> list[str]:
    """Say what was received, what came of it, and where it is, line by line."""
    counts = chain.counts
    why = ", ".join(f"{count} {words(name)}" for name, count in monitor.reasons.most_common())
    lines = [
        f"{counts.received} frames received: {counts.solved} count, {counts.marked} do not"
        f"{f' ({why})' if why else ''}",
        f"{counts.late} frames late, {counts.doubled} samples doubled, {counts.out_of_order} out "
        "of order",
        *(f"{n} samples of stream {name} never arrived" for name, n in monitor.losses.lost.items()),
    ]
    for variant, rms in monitor.condition.rms.items():
        limits = monitor.limits[variant]
        lines.append(
            f"residuals {variant}, {monitor.condition.cycles} gait cycles of both feet: "
            f"RMS {in_words(rms)}; "
            f"peaks {limits.force_n:.0f} N (published limit {limits.max_force_n:.0f} N) and "
            f"{limits.moment_nm:.0f} N·m ({limits.max_moment_nm:.0f} N·m)"
        )
    if beside := monitor.condition.not_carried:
        lines.append(f"{beside} gait cycles left out: the plates did not carry the subject in them")
    if counts.received and not monitor.condition.cycles:
        lines.append("no gait cycle counts, so that no residuals are summed up")
    if not counts.received:
        lines.append(f"stream {chain.stream.name} has sent no frame: does its program measure?")
    else:
        lines.append(
            f"from arrival to results: median {monitor.latency_ms(50):.2f} ms, 99 % within "
            f"{monitor.latency_ms(99):.2f} ms"
        )
    if session.fault is not None:
        lines.append(f"ended by itself: {session.fault}")
    if recorder.fault is not None:
        lines.append(f"{recorder.fault}; {recorder.lost} entries are missing")
    lines.append(f"recorded: {folder / STREAMS} (any command reads it), {folder / RESULTS}")
    return lines


def words(reason: str) -> str:
    """Put a reason why frames do not count into words.

    Examples
    --------
    >>> words("FORCES_UNKNOWN")
    'forces unknown'
    """
    return reason.lower().replace("_", " ")
