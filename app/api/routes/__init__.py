"""Which URL leads to which use case."""
