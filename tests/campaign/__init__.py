"""Random cases in large numbers, each compared with an answer by another route."""
