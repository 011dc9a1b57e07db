"""The loop on measured data: base maps, residuals, effects, adoption, and what is left."""
