"""Pages that people read: HTML of what services return."""
