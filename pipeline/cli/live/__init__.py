"""The same numbers while the subject walks, on the command line."""
