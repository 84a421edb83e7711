"""What is wrong with a trial: suspicions weighed against their rivals, corrections tried."""
