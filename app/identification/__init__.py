"""What the model lacks: which effects the residuals hold, how sure that is, and what remains."""
