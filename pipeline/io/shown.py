"""What a value shows of itself in a Python session and in a notebook."""

from collections.abc import Mapping, Sequence
from html import escape
from typing import TYPE_CHECKING, NamedTuple

if TYPE_CHECKING:
    import pandas as pd


class Overview(NamedTuple):
    """A title, and a small table: names of its columns, name of a row -> its cells."""

    title: str
    columns: Sequence[str]
    rows: Mapping[str, Sequence[object]]

    @property
    def table(self) -> "pd.DataFrame":
        """The table."""
        import pandas as pd

        return pd.DataFrame.from_dict(dict(self.rows), "index", columns=[*self.columns])


class Shown:
    """A value that shows an overview in place of all of its numbers."""

    __slots__ = ()

    def overview(self) -> Overview:
        """Give title and table."""
        raise NotImplementedError

    def __repr__(self) -> str:
        shown = self.overview()
        return f"{shown.title}\n{shown.table}" if shown.rows else shown.title

    def _repr_html_(self) -> str:
        shown = self.overview()
        return f"<pre>{escape(shown.title)}</pre>{shown.table.to_html(max_rows=60)}"
