"""What the pages that report have in common: tables, figures, words and style."""
