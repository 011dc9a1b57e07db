"""thermap: thermal error maps of machine tools, and compensation tables for live temperatures."""

from thermap import __version__

__all__ = ["__version__"]
