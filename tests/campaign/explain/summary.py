"""What a campaign shows: coverage of intervals, right and wrong causes."""

from collections.abc import Iterator
from typing import Final

import pandas as pd

from pipeline.explain.budget import TOLD
from pipeline.explain.cause import OF_PERSON
from tests.campaign.explain.faults import ALWAYS_THERE
from tests.campaign.explain.rows import TOGETHER

INSIDE: Final = 1.96
LARGE: Final = 0.2
"""Share of the mean square of an axis above which a cause should be found first."""
CLAIMED: Final = 0.1
"""Share above which a group of causes counts as claimed."""
NOTHING: Final = 0.02
"""Of a usual size: what is smaller counts as absent."""
USUAL: Final = "as usual"
PERSON: Final = "body and markers"


def summary(sizes: pd.DataFrame, shares: pd.DataFrame) -> str:
    """Give what a campaign shows as text."""
    off = (sizes["size"] - sizes.true).abs()
    sizes = sizes.assign(held=off <= INSIDE * sizes.deviation)
    lines = [f"{shares.trial.nunique()} trials"]
    lines += overall(sizes[sizes.prior == USUAL], "prior as usual")
    for factor, own in sizes[sizes.prior != USUAL].groupby("factor"):
        lines += overall(own, f"one prior × {factor:.2g}")
    lines += first(found(shares[shares.prior.isna()], shares[shares.prior == USUAL]))
    lines += absent(shares[shares.prior == USUAL])
    return "\n\n".join(lines)


def overall(sizes: pd.DataFrame, title: str) -> Iterator[str]:
    """Give the coverage of all intervals."""
    seeded = (sizes.true.abs() > NOTHING * sizes.usual).astype(bool)
    instruments = ~sizes.group.isin(ALWAYS_THERE)
    told = sizes.deviation < TOLD * sizes.usual
    for name, chosen in (
        ("sizes of seeded faults of instruments", seeded & instruments),
        ("of these, sizes that the trial tells of", seeded & instruments & told),
        ("of these, sizes that it does not tell of", seeded & instruments & ~told),
        ("sizes of faults that are absent", ~seeded),
        ("sizes of the body", seeded & ~instruments),
    ):
        held = sizes.held[chosen]
        yield f"{title}: {name}: {percent(held)} % of {len(held)} within their 95 % intervals"


def found(seeded: pd.DataFrame, said: pd.DataFrame) -> pd.DataFrame:
    """Give every fault that makes a large share of an axis, and the rank of its group there.

    Its group is truly the largest where it makes more than any other. What was not seeded is the
    person's: other inertias, joints and skin than the model's.
    """
    truth = seeded.assign(groups=seeded.groups.map(named))
    rows = []
    for (trial, axis), makes in truth.groupby(["trial", "axis"]):
        own = said[(said.trial == trial) & (said.axis == axis)]
        own = own.sort_values("share", ascending=False)
        ranked = [{named(group) for group in each.split(TOGETHER)} for each in own.groups]
        shares = makes.groupby("groups").true.sum().to_dict()
        shares[PERSON] = shares.get(PERSON, 0.0) + 1 - sum(shares.values())
        for group in makes.groups[makes.true >= LARGE]:
            instruments = [each for each in ranked if not each <= {PERSON, *ALWAYS_THERE}]
            rows.append(
                {
                    "instrument": group != PERSON,
                    "largest": shares[group] >= max(shares.values()),
                    "first": bool(ranked) and group in ranked[0],
                    "first of instruments": bool(instruments) and group in instruments[0],
                }
            )
    return pd.DataFrame(rows, columns=["instrument", "largest", "first", "first of instruments"])


def named(group: str) -> str:
    """Give the group as which a group is named."""
    return PERSON if group in OF_PERSON else group


def first(faults: pd.DataFrame) -> Iterator[str]:
    """Say how often the right cause is first."""
    instruments = faults[faults.instrument.astype(bool)]
    for own, words in (
        (faults[faults.largest.astype(bool)], "a fault that is truly the largest"),
        (instruments, "a fault of an instrument"),
        (
            instruments[instruments.largest.astype(bool)],
            "a fault of an instrument that is truly the largest",
        ),
    ):
        yield (
            f"{words} that makes {100 * LARGE:.0f} % of an axis or more: its group is first in "
            f"{percent(own['first'])} % of {len(own)} axes, first of all instruments in "
            f"{percent(own['first of instruments'])} %"
        )


def absent(said: pd.DataFrame) -> Iterator[str]:
    """Say how often absent causes are claimed."""
    said = said[said.absent.astype(str).eq("True")]
    above = said.share > CLAIMED
    claimed = said.assign(above=above, claimed=above & (said.share > INSIDE * said.deviation))
    each = claimed.groupby(["trial", "groups"])[["above", "claimed"]].any()
    for name, words in (
        ("above", "a share"),
        ("claimed", "a share that is not zero by its interval and"),
    ):
        yield (
            f"absent groups with {words} above {100 * CLAIMED:.0f} % of any axis: "
            f"{percent(each[name])} % of {len(each)}"
        )


def percent(held: pd.Series) -> str:
    """Give a share in per cent."""
    return f"{100 * held.astype(float).mean():.1f}" if len(held) else "–"
