"""Marker labels of any format."""

from collections import Counter
from collections.abc import Mapping


def rename_markers(markers: Mapping[str, int], rename: Mapping[str, str]) -> dict[str, int]:
    """Give markers new labels.

    Parameters
    ----------
    markers
        Label -> index of the point.
    rename
        Old label -> new label; labels that it does not name stay.

    Returns
    -------
    dict[str, int]
        New label -> index, in the same order.

    Raises
    ------
    ValueError
        A label to rename is not there, or two labels become the same.
    """
    if absent := sorted(set(rename) - set(markers)):
        raise ValueError(
            f"no marker {', '.join(absent)} to rename; present: {', '.join(sorted(markers))}"
        )
    names = [rename.get(name, name) for name in markers]
    if twice := sorted(name for name, count in Counter(names).items() if count > 1):
        raise ValueError(f"renaming gives several markers the same label: {', '.join(twice)}")
    return dict(zip(names, markers.values(), strict=True))
