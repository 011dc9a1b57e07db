"""Methods that turn what an instrument read into error components: one file a method."""
