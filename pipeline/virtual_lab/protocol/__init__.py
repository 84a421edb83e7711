"""What the virtual laboratory records."""
