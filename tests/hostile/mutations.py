"""What is made of good samples: pieces cut, repeated, exchanged, and put in from elsewhere."""


def mutated(random_, samples, pieces):
    """Change one of some samples of bytes in none to ten places."""
    content = bytearray(random_.choice(samples))
    for _ in range(random_.choice([0, 1, 1, 2, 4, 10])):
        at, kind = random_.randint(0, len(content)), random_.random()
        if kind < 0.3:
            content[at : at + random_.randint(0, 8)] = random_.choice(pieces)
        elif kind < 0.5:
            content[at : at + 1] = random_.randbytes(1)
        elif kind < 0.7:
            del content[at : at + random_.randint(1, 30)]
        elif kind < 0.85:
            other = random_.choice(samples)
            begin = random_.randint(0, len(other))
            content[at:at] = other[begin : begin + random_.randint(1, 60)]
        else:
            content[at:at] = content[at : at + random_.randint(1, 60)] * random_.randint(1, 20)
    return bytes(content)
