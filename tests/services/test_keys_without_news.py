"""Keys follow the database by a clock of their own: also where PostgreSQL's news do not come.

Who revokes does it beside the service. The service's other connections to the database work.
"""

from contextlib import closing
from time import monotonic, sleep

import httpx
import pytest
from sqlalchemy import make_url

from app.access.keys import Role
from app.services.access_keys import create_key, revoke_key
from app.storage.database import Database
from tests.followed_streams import opened
from tests.service_examples import ROOM, problem, temperatures
from tests.services.tcp_proxy import Deaf

SOON_S = 60.0
"""A machine may be slow, but nothing hangs."""

STATED = {"temperatures_c": temperatures(25.0)}


@pytest.mark.slow
@pytest.mark.parametrize("path", ["/v1/stream", f"{ROOM}/compensation/stream"])
@pytest.mark.parametrize("deaf", Deaf)
def test_a_revoked_key_is_refused_and_its_idle_stream_ends(wire, clock, deaf, path):
    url = make_url(wire.url)
    direct = url.set(port=wire._target[1]).render_as_string(False)
    seen_through = url.update_query_dict({"sslmode": "disable"}).render_as_string(False)
    with closing(Database(direct)) as beside:
        guest = create_key(beside, "guest", Role.VIEWER).secret
        headers = {"Authorization": f"Bearer {guest}"}
        with opened(seen_through, clock, analyses=False, require_keys=True) as shop:
            until(lambda: wire.is_listened_through)
            with shop.follow(path, headers=headers) as stream:
                assert stream.until("status") is not None
                wire.deafen(deaf)
                revoke_key(beside, "guest")
                end_s = monotonic() + SOON_S
                while stream.next() is not None:
                    assert monotonic() < end_s, "the stream goes on"
            # Of memory alone: what is read from the database looks there for the key, too.
            answer = httpx.post(
                f"{shop.url}{ROOM}/compensation", json=STATED, headers=headers, trust_env=False
            )
            assert "revoked" in problem(answer, 401)["detail"]


def until(is_so):
    end_s = monotonic() + SOON_S
    while not is_so():
        assert monotonic() < end_s, "it never was"
        sleep(0.02)
