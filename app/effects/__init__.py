"""What a model can lack: one file for each kind of effect, all of one shape."""
