"""Live: streams in, results out, frame by frame."""
