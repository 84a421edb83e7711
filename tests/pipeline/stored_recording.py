"""A recording for the viewer, read back from its file."""

import numpy as np
from rerun.chunk import RrdReader

TIMELINES = {"time", "frame", "gait cycle", "gait cycle, %"}


class Stored:
    """A recording file, read back entity by entity."""

    def __init__(self, path):
        self.reader = RrdReader(path)
        self.tables = {}
        for chunk in self.reader.stream():
            batch = chunk.to_record_batch()
            lines = TIMELINES & {*batch.schema.names}
            for timeline in [None] if chunk.is_static else lines:
                self.tables.setdefault((chunk.entity_path, timeline), []).append(batch)

    def rows(self, entity, name, static=False, timeline="time"):
        """Give an entity's values on a timeline, one array per row, in order."""
        return [np.array(row) for row in self.lists(entity, name, static, timeline)]

    def lists(self, entity, name, static=False, timeline="time"):
        """The same as lists, where instances of a row differ in length."""
        batches = self.tables[f"/{entity}".replace(" ", "\\ "), None if static else timeline]
        column = next(
            column
            for batch in batches
            for column in batch.schema.names
            if column.endswith(f":{name}")
        )
        return [row for batch in batches for row in batch.column(column).to_pylist()]

    def times(self, entity, timeline="time"):
        batches = self.tables[f"/{entity}", timeline]
        values = np.concatenate([b.column(timeline).to_numpy(False) for b in batches])
        return values / np.timedelta64(1, "s") if timeline == "time" else values
