"""Files as people and instruments write them, read to the bodies of the contract's requests.

The command line reads its files here before it sends them, and the service those that a page
uploads: both complain of the same line in the same words.
"""
