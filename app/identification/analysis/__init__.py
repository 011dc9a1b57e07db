"""From residuals to named effects."""
