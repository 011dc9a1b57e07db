"""Whether the machine is still as its model says."""
