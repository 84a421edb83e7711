"""One trial: from a recording to `TrialResult`."""
