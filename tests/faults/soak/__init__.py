"""A fleet at work while everything goes wrong, and every table that it is given computed again."""
