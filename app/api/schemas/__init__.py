"""The shapes of what travels over HTTP, with units and examples."""
