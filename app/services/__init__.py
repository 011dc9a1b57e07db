"""One use case per file: what a user asks for, from checking to commit."""
