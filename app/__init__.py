"""thermap: thermal error maps of machine tools, and the compensation table for live temperatures."""

__version__ = "0.1.0"
