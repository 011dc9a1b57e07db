"""The command line: thermap serve, demo, import, compensate, replay."""

from app.cli.application import application, main

__all__ = ["application", "main"]
