"""Use cases by subject: what a user asks for, from checking to commit.

Each raises `UnknownThing` where the machine, or what is named of it, is not stored; its `Raises`
lists what else a caller has to expect.
"""
