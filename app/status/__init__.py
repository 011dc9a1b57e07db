"""Whether a machine can be trusted now: the verdict that everything else repeats word for word."""
