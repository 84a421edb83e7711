"""The two engines of inverse dynamics: the package's own kernels, and Pinocchio."""
