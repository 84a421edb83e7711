"""Speed and accuracy of the kernels and of other programs on the same problems.

``python -m tests.benchmarks``
"""
