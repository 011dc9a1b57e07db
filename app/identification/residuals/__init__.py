"""What was measured minus what the model says, and how sure both are."""
