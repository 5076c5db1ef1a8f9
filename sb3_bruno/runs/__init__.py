"""What lies in a run's folder: its record, its clock, its origin."""
