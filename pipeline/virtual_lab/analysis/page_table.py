"""Tables of pages."""


def markdown(rows: list[list[str]]) -> str:
    """Lay out rows as a table in Markdown, the first being its heads.

    Examples
    --------
    >>> print(markdown([["axis", "RMS"], ["Fx", "3.1"]]))
    | axis | RMS |
    | --- | --- |
    | Fx | 3.1 |
    """
    lines = [rows[0], ["---"] * len(rows[0]), *rows[1:]]
    return "\n".join(f"| {' | '.join(line)} |" for line in lines)
