"""What is computed of one frame, from samples that arrive."""
