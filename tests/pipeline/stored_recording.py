"""A recording for the viewer, read back from its file."""

import numpy as np
from rerun.chunk import RrdReader


class Stored:
    """A recording file, read back entity by entity."""

    def __init__(self, path):
        self.reader = RrdReader(path)
        self.tables = {}
        for chunk in self.reader.stream():
            static = chunk.is_static
            self.tables.setdefault((chunk.entity_path, static), []).append(chunk.to_record_batch())

    def rows(self, entity, name, static=False):
        """Give an entity's values, one array per row, in order."""
        return [np.array(row) for row in self.lists(entity, name, static)]

    def lists(self, entity, name, static=False):
        """The same as lists, where instances of a row differ in length."""
        column = next(
            column
            for batch in self.tables[f"/{entity}", static]
            for column in batch.schema.names
            if column.endswith(f":{name}")
        )
        batches = self.tables[f"/{entity}", static]
        return [row for batch in batches for row in batch.column(column).to_pylist()]

    def times(self, entity, timeline="time"):
        batches = self.tables[f"/{entity}", False]
        values = np.concatenate([b.column(timeline).to_numpy(False) for b in batches])
        return values / np.timedelta64(1, "s") if timeline == "time" else values
