"""Adopted effects: in the live table, in predictions, and from one model version to the next."""
