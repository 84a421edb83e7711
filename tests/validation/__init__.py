"""Studies of our own that say how good the pipeline is; the docs have their numbers."""
