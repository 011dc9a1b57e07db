"""The kinds of effects: one file a kind."""
