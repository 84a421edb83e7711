"""Numbers of frames as small Parquet files, one after the other in a folder."""

from collections.abc import Sequence
from pathlib import Path
from typing import Final

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq

from hbm.spatial import Array
from pipeline.io.write import whole_file

PART: Final = "part_{number:06d}.parquet"


class ResultParts:
    """Rows of numbers, collected and written as a Parquet file of their own whenever asked.

    Every file is written whole or not at all; ``pandas.read_parquet`` of the folder gives all rows
    in their order.

    Parameters
    ----------
    folder
        Where; it must not have parts yet.
    columns
        Names of the numbers of a row.

    Raises
    ------
    OSError
        If the folder cannot be made.
    """

    def __init__(self, folder: Path, columns: Sequence[str]) -> None:
        folder.mkdir(parents=True)
        self._folder, self._columns = folder, tuple(columns)
        self._rows: list[Array] = []
        self._number = 0

    def add(self, row: Array) -> None:
        """Keep a row, (K,), until the next part is written."""
        self._rows.append(row)

    def write(self) -> None:
        """Write the rows since the last call, if any, as the next part.

        Raises
        ------
        OSError
            If the disk is full; the rows are kept.
        """
        if not self._rows:
            return
        values = np.array(self._rows)
        table = pa.table(dict(zip(self._columns, values.T.copy(), strict=True)))
        with whole_file(self._folder / PART.format(number=self._number + 1)) as temporary:
            pq.write_table(table, temporary)
        self._number += 1
        self._rows.clear()
