"""What a value shows of itself in a Python session and in a notebook."""

from html import escape
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    import pandas as pd


class Shown:
    """A value that shows a title and a small table in place of all of its numbers."""

    __slots__ = ()

    def overview(self) -> "tuple[str, pd.DataFrame]":
        """Give title and table."""
        raise NotImplementedError

    def __repr__(self) -> str:
        title, table = self.overview()
        return f"{title}\n{table}" if len(table) else title

    def _repr_html_(self) -> str:
        title, table = self.overview()
        return f"<pre>{escape(title)}</pre>{table.to_html(max_rows=60) if len(table) else ''}"
