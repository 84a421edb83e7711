"""Many trials: jobs, results on disk, where they come from."""
