"""What happened to a machine, and by whose doing."""
