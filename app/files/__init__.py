"""Files as people and instruments write them, read to the bodies of the contract's requests.

Whoever reads one complains of the same line in the same words. What a body may hold, `app/api`
checks.
"""
