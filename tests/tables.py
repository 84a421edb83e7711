"""Tables of what tests and campaigns find, and the help of the commands that find it."""

from argparse import ArgumentParser, RawDescriptionHelpFormatter
from collections.abc import Mapping

import pandas as pd

from pipeline.statistics.table_3 import markdown_table


def markdown(table: pd.DataFrame, digits: int = 2) -> str:
    """Give a table as Markdown, numbers with so many digits after the point."""
    cells = [
        [f"{v:.{digits}f}" if isinstance(v, float) else str(v) for v in row]
        for row in table.itertuples(index=False)
    ]
    return markdown_table([*map(str, table.columns)], cells)


def described(heading: str, lines: Mapping[str, str]) -> str:
    """Give a list of names, each with its line, for the help of a command."""
    width = max(map(len, lines))
    return "\n".join([f"{heading}:", *(f"  {n:{width}}  {line}" for n, line in lines.items())])


def command(module: str, text: str | None, *lists: str) -> ArgumentParser:
    """Give the parser of ``python -m MODULE``, whose help has a text and lists as they stand."""
    return ArgumentParser(
        prog=f"python -m {module}",
        description=text,
        epilog="\n\n".join(lists),
        formatter_class=RawDescriptionHelpFormatter,
    )
