"""The search for what the model lacks: rows and candidates in, findings out."""
