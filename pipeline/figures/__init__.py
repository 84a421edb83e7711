"""How figures look, and the figure of residuals that several rooms show."""
