"""What is found on the way through a trial, as data."""
