"""How fast the kernels are beside others on the same problems: ``python -m tests.benchmarks``."""
