"""The example machine: simulated after the chapter, and said to be."""
