"""The style of all figures, and the figure of residuals that several packages show."""
