"""What must not happen, tried: killing, stopping, pausing and filling what thermap runs on."""
