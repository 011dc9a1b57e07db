"""What every machine looks like now, in memory: its compiled model and its latest readings."""
