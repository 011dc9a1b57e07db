"""The command line: thermap serve, demo, import, compensate, analyse, accuracy …, simulate."""

from app.cli.application import application, main

__all__ = ["application", "main"]
