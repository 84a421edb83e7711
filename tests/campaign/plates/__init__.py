"""Campaign of force plates with known faults."""
