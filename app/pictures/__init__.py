"""Pictures of a machine's errors, made from an error field: no files, no HTTP."""
