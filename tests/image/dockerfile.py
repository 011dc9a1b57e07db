"""What a Dockerfile says, read: its stages, and the instructions in each."""

import json
import re
import shlex
from dataclasses import dataclass, field


@dataclass
class Stage:
    """One `FROM` and what follows it; the arguments of an instruction as they stand."""

    base: str
    name: str
    instructions: list = field(default_factory=list)

    def all_of(self, instruction):
        """The arguments of each such instruction."""
        return [arguments for name, arguments in self.instructions if name == instruction]

    def the(self, instruction):
        """The arguments of the last one: that counts."""
        return self.all_of(instruction)[-1]

    @property
    def environment(self):
        """What all of `ENV` together set."""
        pairs = [pair for line in self.all_of("ENV") for pair in shlex.split(line)]
        return dict(pair.split("=", 1) for pair in pairs)


def read_dockerfile(text):
    """Read the stages."""
    joined = re.sub(r"\\\n\s*", "", re.sub(r"(?m)^#.*\n", "", text))
    stages = []
    for line in filter(None, map(str.strip, joined.splitlines())):
        instruction, arguments = line.split(None, 1)
        if instruction == "FROM":
            base, _, name = arguments.partition(" AS ")
            stages.append(Stage(base, name))
        else:
            stages[-1].instructions.append((instruction, arguments.strip()))
    return stages


def words_of(arguments):
    """The words of a command; only the form without a shell is taken."""
    words = json.loads(arguments)
    assert words
    assert all(isinstance(word, str) for word in words)
    return words


def health_of(stage):
    """The words of the health command."""
    arguments = stage.the("HEALTHCHECK")
    return words_of(arguments[arguments.index("CMD") + len("CMD") :])
