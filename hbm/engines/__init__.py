"""The two engines of inverse dynamics: Pinocchio, and the package's own kernels."""
