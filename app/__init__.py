"""thermap: thermal error maps of machine tools, and compensation tables for live temperatures."""

__version__ = "0.1.0"
