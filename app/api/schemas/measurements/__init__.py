"""What instruments read, and what becomes of it, over HTTP: one file for each kind of method."""
