"""The live compensation in LinuxCNC's HAL.

Everything here runs in LinuxCNC's own Python, which may be older than ours (3.9) and has none of
our libraries: the standard library only, and nothing of `app` outside this room.
"""
