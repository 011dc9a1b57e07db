"""The dashboard: all machines at a glance, and one machine now."""
