"""Use cases by subject: what a user asks for, from checking to commit."""
