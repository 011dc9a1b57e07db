"""HTTP: routes, the shapes of what travels, and errors as problem details."""
