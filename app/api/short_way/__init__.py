"""The short way to the live table and for readings, past the framework.

Routing, dependencies, middlewares and models cost several times what the table itself costs, or to
store a few readings. A short request for a machine in memory, with content in order, is
answered here. Everything else, and everything that is wrong in any way, goes the ordinary way with
what has been read of it, so that there is one place for refusals and their words.
"""
