"""What is wrong again and again is logged once in a while."""

import logging

from app.connections import sparing_log
from app.connections.sparing_log import LOGGED_EVERY_S, SparingLog


def test_a_thing_is_said_once_and_then_counted(caplog, monkeypatch):
    caplog.set_level(logging.WARNING, "thermap")
    now_s = 0.0
    monkeypatch.setattr(sparing_log, "monotonic", lambda: now_s)
    log = SparingLog()
    for _ in range(100):
        log.warn("ram", "ram: expected Good, got Bad")
    log.warn("bed", "bed: expected Good, got Bad")
    assert caplog.messages == ["ram: expected Good, got Bad", "bed: expected Good, got Bad"]
    now_s = LOGGED_EVERY_S
    log.warn("ram", "ram: expected Good, got nan")
    log.warn("ram", "ram: expected Good, got nan")
    assert caplog.messages[2:] == ["ram: expected Good, got nan (and 99 more since the last)"]
