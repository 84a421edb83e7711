"""What the virtual laboratory records: three experiments and a single trial."""
