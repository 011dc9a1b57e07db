"""Where performance claims come from: ratios measured in one run."""
