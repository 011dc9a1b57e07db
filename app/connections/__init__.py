"""What machines, controllers and plants are connected by beside HTTP."""
