"""Tables of what tests and campaigns find."""

import pandas as pd

from pipeline.statistics.table_3 import markdown_table


def markdown(table: pd.DataFrame, digits: int = 2) -> str:
    """Give a table as Markdown, numbers with so many digits after the point."""
    cells = [
        [f"{v:.{digits}f}" if isinstance(v, float) else str(v) for v in row]
        for row in table.itertuples(index=False)
    ]
    return markdown_table([*map(str, table.columns)], cells)
