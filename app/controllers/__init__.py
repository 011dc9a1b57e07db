"""What a controller holds: one file format a file, written and read back; no I/O."""
