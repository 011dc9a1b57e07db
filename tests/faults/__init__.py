"""What must not happen, tried: killing, stopping and pausing what thermap runs on."""
