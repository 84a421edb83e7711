"""What a laboratory should know before the subject has gone home, noted as it arises."""
