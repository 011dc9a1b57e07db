"""The loop closed on the running LinuxCNC, on a plant with errors that nobody has declared."""
