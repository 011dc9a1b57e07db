"""A fleet that works while everything goes wrong, and every table that it is given computed again."""
