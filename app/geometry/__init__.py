"""The machine in space: error components, the chain of axes, the volumetric error."""
