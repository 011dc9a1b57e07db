"""What the component says of its exchange with the service, and how often."""

from itertools import chain, repeat
from threading import Event

from app.hal.component import Exchange


class RefusingService:
    """A service that refuses with one sentence after the other, and then says nothing more."""

    def __init__(self, sentences):
        self._sentences = iter(sentences)
        self.ended = Event()

    def table(self):
        sentence = next(self._sentences, None)
        if sentence is None:
            self.ended.set()
            Event().wait()
        raise ValueError(sentence)

    def forget(self):
        pass


def said_of(sentences, capsys):
    service = RefusingService(sentences)
    exchange = Exchange(service, {"x": (0.0, 1.0)}, 0.0, 500.0)
    exchange.tell({}, {})
    exchange.start()
    assert service.ended.wait(60.0)
    return [line.rpartition("held: ")[2] for line in capsys.readouterr().err.splitlines()]


def test_a_refusal_with_an_age_in_it_is_said_once(capsys):
    old = [f"z1 is {age} s old, and 60.0 s are allowed" for age in (61.2, 71, "1,081.5")]
    other = "z2 is 61.2 s old, and 60.0 s are allowed"
    assert said_of([*old, other, *old], capsys) == [old[0], other, old[0]]


def test_refusals_that_come_in_turn_are_all_said(capsys):
    turns = ["no reading", "no model"]
    assert said_of(chain(*repeat(turns, 2)), capsys) == turns * 2
