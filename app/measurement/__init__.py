"""Methods that turn what an instrument read into error components: each in the file of its name.

A method with much to take or to say keeps that beside it, in files that begin with its name. What
is refused is refused with `InvalidContent`, which names the field.
"""
