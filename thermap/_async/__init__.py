"""The client to be awaited, of which the blocking one is made."""
