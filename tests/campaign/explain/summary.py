"""What a campaign shows: coverage of intervals, right and wrong causes."""

import re
from collections.abc import Iterator
from typing import Final

import numpy as np
import pandas as pd

from pipeline.explain.budget import TOLD
from pipeline.explain.cause import OF_PERSON
from pipeline.io.write import markdown
from tests.campaign.explain.faults import ALWAYS_THERE
from tests.campaign.explain.rows import SHARES, SIZES, TOGETHER, Tables

INSIDE: Final = 1.96
LARGE: Final = 0.2
"""Share of the mean square of an axis above which a cause should be found first."""
CLAIMED: Final = 0.1
"""Share above which a group of causes counts as claimed."""
NOTHING: Final = 0.02
"""Of a usual size: what is smaller counts as absent."""
USUAL: Final = "as usual"
PERSON: Final = "body and markers"


def summary(tables: Tables) -> str:
    """Give the tables of a campaign as text."""
    sizes, shares = tables.read(SIZES), tables.read(SHARES)
    sizes = sizes.assign(
        kind=[kind_of(name) for name in sizes.cause],
        z=(sizes["size"] - sizes.true) / sizes.deviation,
    )
    sizes["held"] = sizes.z.abs() <= INSIDE
    usual = sizes[sizes.prior == USUAL]
    parts = [
        f"{shares.trial.nunique()} trials",
        markdown(coverage(usual)),
        *overall(usual, "prior as usual"),
        *wrong_prior(sizes[sizes.prior != USUAL]),
        *first(shares, USUAL),
        markdown(ranks(shares, USUAL)),
        *absent(shares, USUAL),
        markdown(sizes_of_shares(shares)),
    ]
    return "\n\n".join(parts)


def kind_of(cause: str) -> str:
    """Give the kind of a cause: its name without plate, side and axis."""
    name = re.sub(r"^plate \d: |^(left|right) ", "", cause)
    name = re.sub(r" (along|about) ([xyz])$", r"", name)
    return re.sub(r"\b([FM])[xyz]$", r"\1", name)


def coverage(sizes: pd.DataFrame) -> pd.DataFrame:
    """Give a row per kind of cause; sizes by what is usual of them."""
    rows = []
    for (group, kind), own in sizes.groupby(["group", "kind"], sort=False):
        seeded = own[~np.isclose(own.true, 0, atol=NOTHING * own.usual)]
        rows.append(
            {
                "group": group,
                "cause": kind,
                "seeded": len(seeded),
                "held %": percent(seeded.held),
                "absent": len(own) - len(seeded),
                "held, absent %": percent(own.held[~own.index.isin(seeded.index)]),
                "RMS z": f"{np.sqrt(np.mean(seeded.z**2)):.2f}" if len(seeded) else "–",
                "mean z": f"{seeded.z.mean():+.2f}" if len(seeded) else "–",
                "true/usual": f"{np.sqrt(np.mean((seeded.true / seeded.usual) ** 2)):.2f}"
                if len(seeded)
                else "–",
                "sd/usual": f"{(own.deviation / own.usual).median():.2f}",
            }
        )
    return pd.DataFrame(rows)


def overall(sizes: pd.DataFrame, title: str) -> Iterator[str]:
    """Give the coverage of all intervals."""
    seeded = ~np.isclose(sizes.true, 0, atol=NOTHING * sizes.usual)
    instruments = ~sizes.group.isin(ALWAYS_THERE)
    told = sizes.deviation < TOLD * sizes.usual
    for name, chosen in (
        ("sizes of seeded faults of instruments", seeded & instruments),
        ("of these, sizes that the trial tells of", seeded & instruments & told),
        ("of these, sizes that it does not tell of", seeded & instruments & ~told),
        ("sizes of faults that are absent", ~seeded),
        ("sizes of the body", seeded & ~instruments),
        ("all", seeded | True),
    ):
        own = sizes[chosen]
        each = own.groupby("trial").held.mean()
        error = 100 * each.std() / max(len(each), 1) ** 0.5
        yield (
            f"{title}: {name}: {percent(own.held)} % of {len(own)} within their 95 % intervals "
            f"(standard error between trials {error:.1f} %)"
        )


def wrong_prior(sizes: pd.DataFrame) -> Iterator[str]:
    """Give the coverage where one prior was wrong, of all causes and of that one."""
    for factor, own in sizes.groupby("factor"):
        yield from overall(own, f"one prior × {factor:.2g}")


def faults_and_claims(shares: pd.DataFrame, prior: str) -> Iterator[dict[str, object]]:
    """Give every fault that makes a large share of an axis, and the rank of its group there.

    Its group is truly the largest where it makes more than any other. What was not seeded is the
    person's: other inertias, joints and skin than the model's are in every trial.
    """
    seeded = shares[shares.seeded.notna()]
    groups = seeded.assign(groups=[named(group) for group in seeded.groups])
    truth = groups.groupby(["trial", "axis", "groups"]).true.sum()
    said = shares[(shares.prior == prior) & (shares.groups != "not explained")]
    by_axis = {key: own for key, own in said.groupby(["trial", "axis"])}
    for fault in groups[groups.true >= LARGE].itertuples():
        own = by_axis[fault.trial, fault.axis].sort_values("share", ascending=False)
        names = [{named(group) for group in each.split(TOGETHER)} for each in own.groups]
        rank = next((k for k, each in enumerate(names) if fault.groups in each), len(names))
        others = [each for each in names[:rank] if not each <= {PERSON, *ALWAYS_THERE}]
        share = float(own.share.iloc[rank]) if rank < len(names) else 0.0
        makes = truth[fault.trial, fault.axis].to_dict()
        makes[PERSON] = makes.get(PERSON, 0.0) + 1 - sum(makes.values())
        yield {
            "trial": fault.trial,
            "axis": fault.axis,
            "fault": fault.seeded,
            "instrument": fault.groups != PERSON,
            "true": fault.true,
            "share": share,
            "alone": rank < len(names) and len(names[rank]) == 1,
            "first": rank == 0,
            "largest": makes[fault.groups] >= max(makes.values()),
            "first of instruments": not others and rank < len(names),
        }


def named(group: str) -> str:
    """Give the group as which a group is named."""
    return PERSON if group in OF_PERSON else group


def ranks(shares: pd.DataFrame, prior: str) -> pd.DataFrame:
    """Give per fault how often its group is first where it makes a large share."""
    found = pd.DataFrame(list(faults_and_claims(shares, prior)))
    if found.empty:
        return found
    rows = []
    for fault, own in found.groupby("fault"):
        rows.append(
            {
                "fault": fault,
                "axes with ≥ 20 %": len(own),
                "true share %": f"{100 * own.true.mean():.0f}",
                "said %": f"{100 * own.share.mean():.0f}",
                "first %": percent(own["first"]),
                "first of instruments %": percent(own["first of instruments"]),
                "named alone %": percent(own.alone),
            }
        )
    return pd.DataFrame(rows)


def first(shares: pd.DataFrame, prior: str) -> Iterator[str]:
    """Say how often the right cause is first."""
    found = pd.DataFrame(list(faults_and_claims(shares, prior)))
    if found.empty:
        return
    instruments = found[found.instrument]
    for own, words in (
        (found, "a fault"),
        (found[found.largest], "a fault that is truly the largest"),
        (instruments, "a fault of an instrument"),
        (instruments[instruments.largest], "a fault of an instrument that is truly the largest"),
    ):
        most = own.loc[own.groupby(["trial", "fault"]).true.idxmax()] if len(own) else own
        yield (
            f"{words} that makes {100 * LARGE:.0f} % of an axis or more: its group is first in "
            f"{percent(own['first'])} % of {len(own)} axes, and in {percent(most['first'])} % of "
            f"{len(most)} faults in their largest axis; first of all instruments in "
            f"{percent(own['first of instruments'])} % and "
            f"{percent(most['first of instruments'])} %"
        )


def absent(shares: pd.DataFrame, prior: str) -> Iterator[str]:
    """Say how often absent causes are claimed."""
    said = shares[(shares.prior == prior) & shares.absent.astype(str).eq("True")]
    claimed = said.assign(
        above=said.share > CLAIMED,
        claimed=(said.share > CLAIMED) & (said.share > INSIDE * said.deviation),
    )
    per_trial = claimed.groupby(["trial", "groups"])[["above", "claimed"]].any()
    for name, words in (
        ("above", "a share"),
        ("claimed", "a share that is not zero by its interval and"),
    ):
        each = per_trial[name]
        groups = ", ".join(
            f"{group} {percent(own)} % of {len(own)}" for group, own in each.groupby("groups")
        )
        yield (
            f"absent groups with {words} above {100 * CLAIMED:.0f} % of any axis: "
            f"{percent(each)} % of {len(each)}: {groups}; of single axes "
            f"{percent(claimed[name])} %; in {percent(each.groupby('trial').any())} % of trials"
        )


def sizes_of_shares(shares: pd.DataFrame) -> pd.DataFrame:
    """Give the mean share of each group and axis, and the residuals themselves."""
    said = shares[shares.prior == USUAL]
    alone = said[~said.groups.str.contains(TOGETHER, regex=False)]
    table = 100 * alone.pivot_table(index="groups", columns="axis", values="share", sort=False)
    table = table.round(0).astype(str).replace("nan", "–")
    per_axis = said.groupby("axis", sort=False)[["rms", "held_out"]].median()
    table.loc["median RMS [N, N·m]"] = per_axis.rms.round(1).astype(str)
    table.loc["median held-out share %"] = (100 * per_axis.held_out).round(0).astype(str)
    return table.rename_axis("mean share % where named alone").reset_index()


def percent(held: pd.Series) -> str:
    """Give a share in per cent."""
    return f"{100 * held.astype(float).mean():.1f}" if len(held) else "–"
