"""How the gait of the virtual people was made, and how real it looks: not part of the package."""
