"""A trial's body and results in the files of other programs."""
