"""NC programs that move a machine through a measurement; one measurement a file, no I/O."""
