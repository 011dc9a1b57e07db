"""Methods of measuring, one file each: what is sent, what a file holds, what is answered.

What a method computes is in `app/measurement`. To add one: a file with its `Method`, its line in
`registry.py`, its page in `docs/methods`, and a test.
"""
