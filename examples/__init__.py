"""Whole chains, to be read and run."""
