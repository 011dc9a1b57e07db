"""What pages and terminal views have in common: figures, names and words."""
