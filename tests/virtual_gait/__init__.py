"""How the simulated gait was made, and how realistic it is; not part of the package."""
