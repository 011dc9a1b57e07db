"""Who may ask the service for what: keys, their roles, and how failures are limited."""
