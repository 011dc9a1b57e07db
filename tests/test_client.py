"""Both clients speak every route, and say in words why a call was not answered.

The same scenarios go through the blocking client to a real server, and through the
awaiting one to the application itself.
"""

import inspect
import json
import re
from contextlib import suppress
from datetime import timedelta

import httpx
import numpy as np
import pytest

from app.api.methods.registry import METHODS
from app.cli.listening import listening, serving, url_of
from app.main import create_app
from app.settings import Settings
from scripts.openapi_document import openapi_document
from tests.service_examples import (
    MACHINE,
    START,
    error_map,
    furnish_database,
    iso,
    reading,
    table,
    temperatures,
)
from thermap import (
    DEFAULT_URL,
    AsyncThermapClient,
    ConflictError,
    InvalidContentError,
    NotAllowedError,
    NotAnalysedError,
    NotListeningError,
    ServiceUnavailableError,
    ThermapClient,
    ThermapClientError,
    TooLargeError,
    TooManyRequestsError,
    UnexpectedAnswerError,
    UnknownThingError,
    calls,
    loop_calls,
)
from thermap.answers import (
    PositioningAnswer,
    ReadingSchema,
    StoredVerificationAnswer,
    VerificationPreview,
)

pytestmark = pytest.mark.anyio


class Awaitable:
    """The blocking client with methods that can be awaited, so that one scenario serves both."""

    def __init__(self, client):
        self._client = client

    def __getattr__(self, name):
        async def method(*arguments, **options):
            return getattr(self._client, name)(*arguments, **options)

        return method


@pytest.fixture
def service(databases):
    url = databases.prepared("sqlite", furnish_database)
    service = create_app(Settings(database_url=url, max_body_bytes=4_000_000, refresh_s=0.05))
    yield service
    service.state.runner.stop()
    service.state.context.database.close()
    databases.give_back(url)


@pytest.fixture
def served_url(service):
    with listening("127.0.0.1", 0, "serve") as opened, serving(service, opened, "warning"):
        yield url_of(opened)


@pytest.fixture
def awaiting(service):
    """In the same process: there is no connection to give up."""
    return AsyncThermapClient("http://localhost", transport=httpx.ASGITransport(app=service))


@pytest.fixture
def blocking(served_url):
    with ThermapClient(served_url) as client:
        yield Awaitable(client)


@pytest.fixture
def client(request):
    """A client of a service that has the example machine with three maps.

    The awaiting one but where a test asks for both: the blocking one is made of its source.
    """
    return request.getfixturevalue(getattr(request, "param", "awaiting"))


both_clients = pytest.mark.parametrize("client", ["blocking", "awaiting"], indirect=True)


def examples_of(method):
    return method.request.model_config.get("json_schema_extra", {})


def answering(*responses, requests=None):
    """A blocking client whose service gives these answers, the last one for ever."""
    remaining = list(responses)

    def handle(request):
        if requests is not None:
            requests.append(request)
        return remaining.pop(0) if len(remaining) > 1 else remaining[0]

    return ThermapClient("http://localhost", transport=httpx.MockTransport(handle))


def failing(error):
    def handle(request):
        raise error

    return ThermapClient("http://localhost", timeout_s=2.0, transport=httpx.MockTransport(handle))


# -- every route ---------------------------------------------------------------------------


async def test_machines(client):
    assert [m.id for m in await client.machines()] == ["mcfv5050"]
    made = await client.create_machine(MACHINE | {"id": "second"})
    assert made.active_model is None
    # x-middle's usual stand-in is the service's to add.
    assert made.sensors[0].stand_in == "y-front"
    assert await client.machine("second") == made
    changed = await client.change_machine("second", {"name": "The second"})
    assert (changed.name, changed.sensors) == ("The second", made.sensors)
    assert (await client.change_machine("second", {"out_of_range": "reject"})).name == "The second"
    assert await client.delete_machine("second") is None
    assert [m.id for m in await client.machines()] == ["mcfv5050"]


@both_clients
async def test_error_maps(client):
    content = error_map("Run #7", 34.0)
    content["components"][0] = {
        "component": "EXX",
        "positions_mm": np.linspace(0, 500, 6)[::2],  # not contiguous
        "errors_um": np.array([0, 14, 70], dtype=np.float32),
    }
    stored = await client.store_error_map("mcfv5050", content)
    assert stored.components[0].errors_um == [0.0, 14.0, 70.0]
    again = await client.store_error_map(
        "mcfv5050",
        error_map("Run #7", 34.0)
        | {
            "components": [
                {"component": "EXX", "positions_mm": [0, 200, 400], "errors_um": [0, 14, 70]},
                *content["components"][1:],
            ]
        },
    )
    assert again.id == stored.id
    assert (stored.activated, [p.component for p in stored.loses]) == (False, ["EXX"])
    of_storing = {"model_version": None, "loses": [], "gains": [], "next_step": None}
    of_storing |= {"waited_before": None, "stays_active": None}
    shown = stored.model_copy(update=of_storing)
    assert await client.error_map("mcfv5050", stored.id) == shown
    assert [m.label for m in await client.error_maps("mcfv5050")][-1] == "Run #7"
    look = await client.preview_map_deletion("mcfv5050", 3)
    assert (look.activated, bool(look.loses)) == (True, True)
    assert await client.delete_error_map("mcfv5050", stored.id) is None
    assert len(await client.error_maps("mcfv5050")) == 3


@pytest.mark.slow
async def test_previews_and_losses_that_are_accepted(client):
    short = error_map("short", 40.0)
    short["components"][0] = table("EXX", [0, 100], [0.0, 20.0])
    look = await client.preview_error_map("mcfv5050", short)
    assert (look.activated, [p.component for p in look.loses]) == (False, ["EXX"])
    assert len(await client.error_maps("mcfv5050")) == 3
    assert not (await client.store_error_map("mcfv5050", short)).activated
    assert (await client.preview_activation("mcfv5050", 4)).loses == look.loses
    assert (await client.store_error_map("mcfv5050", short, accept_losses=True)).activated
    assert (await client.model_coverage("mcfv5050", 4)).components[0] == "EXX"
    assert (await client.preview_assignment("mcfv5050", {"SXY": "spindle"})).activated
    assert (await client.machine("mcfv5050")).active_model == 4


async def test_sensor_assignment_and_models(client):
    before = await client.sensor_assignment("mcfv5050")
    assert before["EXX"] == "x-middle"
    after = await client.assign_sensors("mcfv5050", {"D_x(x)": "z-column"})
    assert after == before | {"EXX": "z-column"}
    proposed = await client.correlate_sensors("mcfv5050")
    assert {c.component for c in proposed.components} == {"EXX", "EBX", "EZZ", "SXY"}
    versions = await client.models("mcfv5050")
    assert [v.active for v in versions] == [False, False, False, True]
    assert (await client.activate_model("mcfv5050", 3)).active
    assert (await client.model("mcfv5050", 4)).active is False


async def test_readings_and_the_current_table(client):
    with pytest.raises(ConflictError, match="no reading yet"):
        await client.current_table("mcfv5050")
    first = reading(START, 22.0)
    done = await client.store_readings("mcfv5050", first)
    assert (done.stored, done.duplicates) == (1, 0)
    later = ReadingSchema(**reading(START + timedelta(seconds=30), 23.0))
    done = await client.store_readings("mcfv5050", [first, later])
    assert (done.stored, done.duplicates) == (1, 1)
    assert await client.readings("mcfv5050", since=later.time) == [later]
    assert len(await client.readings("mcfv5050", until=START, every_s=1.0, limit=5)) == 1
    tagged = await client.current_table("mcfv5050")
    assert tagged.table.reading_time == later.time
    assert await client.current_table("mcfv5050", tagged.etag) is None
    newest = reading(START + timedelta(seconds=60), 23.5)
    await client.store_readings("mcfv5050", newest)
    changed = await client.current_table("mcfv5050", tagged.etag)
    assert changed.etag != tagged.etag


async def test_compensation_and_predictions(client):
    # Between Run #1 (20 °C, 0 µm) and Run #3 (24 °C, 20 µm at 500 mm).
    temperatures_c = {"x-middle": np.float64(21.0), "z-column": 23}
    table = await client.compensation("mcfv5050", temperatures_c, {"spindle_rpm": 0})
    entry = table.components[0]
    assert (entry.component, entry.weight, entry.errors_um[-1]) == ("EXX", 0.25, 5.0)
    await client.store_readings("mcfv5050", reading(START, 21.0))
    predicted = await client.predict(
        "mcfv5050",
        [{"time": START, "component": "EXX", "position_mm": 500.0}],
        model_version=3,
    )
    assert (predicted.predicted_um, predicted.model_version) == ([5.0], 3)


async def test_health(client):
    assert (await client.health()).status == "ok"
    assert "thermap_requests" in await client.metrics()
    assert (await client.ready()).database == "ok"


def test_not_being_ready_is_an_answer():
    answer = {"status": "not-ready", "database": "away", "machines": 2, "machines_in_memory": 0}
    with answering(httpx.Response(503, json=answer)) as client:
        assert client.ready().database == "away"
    with (
        answering(httpx.Response(503, text="<html>no backend</html>")) as client,
        pytest.raises(ServiceUnavailableError),
    ):
        client.ready()


async def test_bytes_as_they_came(client):
    call = calls.compensation("mcfv5050", {"x-middle": 22.0, "z-column": 24.0}, None)
    document = json.loads(await client.content(call))
    assert document["components"][0]["errors_um"] == [0.0, 2.0, 10.0]
    with pytest.raises(UnknownThingError):
        await client.content(calls.machine("nope"))


ASKED = {"temperatures_c": {"x-middle": 25.5, "z-column": 27.5}, "missing_components": "zero"}


async def test_the_machine_in_three_dimensions(client):
    """The example machine at 25.5 °C: see tests/api/test_api_volumetric_error.py."""
    points = np.array([[0.0, 0.0, 0.0], [500.0, 500.0, 500.0]])
    found = await client.volumetric_error("mcfv5050", ASKED | {"points_mm": points})
    np.testing.assert_allclose(found.errors_um, [[0, 0, 0], [42.25, 0, 27.5]], atol=1e-12)
    np.testing.assert_allclose(found.orientation_urad, [[0, 0, 0], [55, 0, 0]], atol=1e-12)
    assert found.head.model_version == 3
    assert "EYY" in found.head.counted_as_zero
    several = [ASKED["temperatures_c"]] * 3
    body = ASKED | {"points_mm": points, "temperatures_c": several}
    assert (await client.volumetric_error("mcfv5050", body)).errors_um.shape == (3, 2, 3)
    with pytest.raises(InvalidContentError, match="outside_travel"):
        await client.volumetric_error("mcfv5050", ASKED | {"points_mm": points - 1.0})


async def test_grids_accuracy_and_levels(client):
    grid = await client.grid("mcfv5050", ASKED | {"tolerance_um": 2.0})
    assert grid.largest_um <= 2.0
    accuracy = await client.volumetric_accuracy("mcfv5050", ASKED)
    assert accuracy.linear.definition_1_um == pytest.approx(np.hypot(27.5, 55.0))
    levels = await client.compensation_levels("mcfv5050", ASKED)
    assert [level.level for level in levels.levels][-1] == "nonrigid"
    lines = {"linear_um": {a: [3.0] for a in "xyz"}}
    lines["straightness_um"] = dict.fromkeys(("EYX", "EZX", "EXY", "EZY", "EXZ", "EYZ"), 1.0)
    assert (await client.accuracy_from_lines(lines)).ratio == pytest.approx(5.0 / 3.0)
    needed = await client.needed_components("mcfv5050", "large-gantry")
    assert "EXY^x" in needed.missing
    (kind,) = [one for one in await client.nonrigid_presets() if one.name == "large-gantry"]
    assert kind == needed.preset
    turn = {"order": "C", "angles_deg": {"C": np.arange(4) * 90.0}, "points_mm": [[100, 0, 0]]}
    assert len((await client.rotary_axis_error("mcfv5050", ASKED | turn)).errors_um) == 4


@pytest.mark.slow
async def test_closing_the_loop(client):
    """EXX is 5 µm at 500 mm and 21 °C; here it is measured with 1 µm more."""
    seen = [
        {"time": START, "component": "EXX", "position_mm": 500.0 - i, "measured_um": 6.0 - i / 100}
        for i in range(9)
    ]
    await client.store_readings("mcfv5050", reading(START, 21.0))
    body = {"label": "v", "repeatability_um": 0.5, "observations": seen}
    stored = await client.store_verification("mcfv5050", body)
    assert stored.judgement.status == "within"
    (listed,) = await client.verifications("mcfv5050")
    assert listed.model_dump() == stored.model_dump(exclude={"warnings"})
    assert (await client.verification("mcfv5050", stored.id)).observations[0].measured_um == 6.0
    left = await client.verification_residuals("mcfv5050", stored.id, rows=2)
    assert (left.overall.mean, len(left.rows)) == (pytest.approx(1.0), 2)
    again = await client.residuals("mcfv5050", [stored.id], model_version=3)
    assert again.overall == left.overall
    assert "residuals</title>" in await client.residuals_page("mcfv5050", [stored.id])
    compared = await client.compare_models("mcfv5050", [stored.id], [2, 3])
    assert [v.version for v in compared.versions] == [2, 3]
    assert (await client.watch("mcfv5050")).verifications[0].verification == stored.id
    plan = await client.plan_analysis("mcfv5050", {"verifications": [stored.id]})
    assert plan.values == 9
    await analyse(client, stored.id)
    assert await client.delete_verification("mcfv5050", stored.id) is None


async def analyse(client, verification_id):
    question = {"verifications": [verification_id], "effects": ["backlash"]}
    job = await client.analyse("mcfv5050", question)
    found = await client.wait_for_analysis("mcfv5050", job.id, timeout_s=60.0)
    assert found.result.values == 9
    assert "<html" in await client.analysis_report("mcfv5050", job.id)
    with pytest.raises(ConflictError, match="done"):
        await client.cancel_analysis("mcfv5050", job.id)
    with pytest.raises(ConflictError, match="no effect"):
        await client.adopt_analysis("mcfv5050", job.id, [0])
    assert [a.id for a in await client.analyses("mcfv5050")] == [job.id]
    assert await client.delete_analysis("mcfv5050", job.id) is None


async def test_pictures(client):
    figure = await client.picture("mcfv5050", ASKED)
    assert "MCFV5050LN" in figure["layout"]["meta"]["title"]
    with pytest.raises(ConflictError, match="no reading yet"):
        await client.current_picture("mcfv5050")
    await client.store_readings("mcfv5050", reading(START, 25.5))
    page = await client.current_picture("mcfv5050", missing_components="zero")
    assert page.startswith("<!doctype html>")


async def test_numbers_that_no_array_is_made_of_are_an_unexpected_answer():
    for content, head in ((b"no array", "{}"), (b"", "{}")):
        client = answering(httpx.Response(200, content=content, headers={"Thermap-Answer": head}))
        with pytest.raises(UnexpectedAnswerError):
            client.volumetric_error("mcfv5050", {})


async def test_files_are_recognised(client, tmp_path):
    check, readings = tmp_path / "night.csv", tmp_path / "x.csv"
    check.write_text(f"time,component,position_mm,measured_um\n{iso(START)},EXX,250,4.31\n")
    readings.write_text(
        "target_mm,forward_1_um,forward_2_um\n0,0.0,0.2\n250,1.9,2.1\n500,4.1,3.9\n"
    )
    look = await client.import_file("mcfv5050", check, preview=True)
    assert isinstance(look, VerificationPreview)
    assert (look.label, look.count, look.components) == ("night", 1, ["EXX"])
    stored = await client.import_file("mcfv5050", str(check))
    assert isinstance(stored, StoredVerificationAnswer)
    assert (await client.verification("mcfv5050", stored.id)).label == "night"
    beside = {"temperatures_c": temperatures(40.0), "axis": "x", "method": "positioning"}
    beside |= {"measured_at": START - timedelta(hours=1), "label": "hot"}
    look = await client.import_file("mcfv5050", readings, preview=True, **beside)
    assert isinstance(look, PositioningAnswer)
    assert (look.label, look.stored, look.preview.activated) == ("hot", False, True)
    assert len(await client.error_maps("mcfv5050")) == 3
    made = await client.import_file("mcfv5050", readings, accept_losses=True, **beside)
    assert (made.label, made.activated) == ("hot", True)
    assert [entry.component for entry in made.components] == ["EXX"]
    assert "A_um" in made.figures or made.figures
    with pytest.raises(InvalidContentError, match=r"night\.csv holds check measurements"):
        await client.import_file("mcfv5050", check, label="mine")


def job(status, progress=0.0, message=""):
    """An analysis as the service answers it."""
    return {
        "id": 3, "status": status, "progress": progress, "message": message, "model_version": 1,
        "verifications": [1], "holdout_fraction": 0.3, "effects": None, "seed": 1,
        "created_at": iso(START), "started_at": None, "finished_at": None, "adopted_version": None,
        "result": None,
    }  # fmt: skip


@pytest.fixture(params=["blocking", "awaiting"])
def client_answering(request):
    """Makes either client, whose service gives these answers, the last one for ever."""

    def make(*contents):
        remaining = list(contents)

        def handle(asked):
            content = remaining.pop(0) if len(remaining) > 1 else remaining[0]
            return httpx.Response(200, json=content)

        transport = httpx.MockTransport(handle)
        if request.param == "awaiting":
            return AsyncThermapClient("http://localhost", transport=transport)
        return Awaitable(ThermapClient("http://localhost", transport=transport))

    return make


async def test_an_analysis_is_waited_for(client_answering, monkeypatch):
    monkeypatch.setattr(loop_calls, "POLL_S", 0.0)
    client = client_answering(job("queued"), job("running", 0.4, "searching"), job("done", 1.0))
    seen = []
    found = await client.wait_for_analysis("vmc", 3, progress=lambda *told: seen.append(told))
    assert found.status == "done"
    assert seen == [(0.0, "queued"), (0.4, "searching"), (1.0, "done")]


@pytest.mark.parametrize(
    ("last", "kind", "words"),
    [
        (job("failed", 0.4, "no readings"), NotAnalysedError, "analysis 3 failed: no readings"),
        (job("cancelled"), NotAnalysedError, "analysis 3 cancelled"),
        (job("running"), TimeoutError, "analysis 3 is running after 0.02 s, and goes on"),
    ],
)
async def test_an_analysis_that_is_not_done_is_no_answer(
    client_answering, monkeypatch, last, kind, words
):
    monkeypatch.setattr(loop_calls, "POLL_S", 0.01)
    client = client_answering(job("queued"), last)
    with pytest.raises(kind, match=f"^{words}$"):
        await client.wait_for_analysis("vmc", 3, timeout_s=0.02)


@pytest.mark.parametrize("method", [m for m in METHODS.values() if "example" in examples_of(m)])
async def test_a_measurement_is_answered_with_its_methods_own_shape(client, method):
    answer = await client.measure("mcfv5050", method.name, examples_of(method)["example"])
    assert type(answer).__name__ == method.answer.__name__
    assert answer.method == method.name
    assert not answer.stored


def test_every_route_has_its_method(tmp_path):
    (tmp_path / "map.csv").write_bytes(b"")
    described = {
        re.sub(r"\{\w+\}", "{}", f"{method.upper()} {path}")
        for path, methods in openapi_document()["paths"].items()
        for method in methods
    }
    requests = []
    client = answering(httpx.Response(200, json=[]), requests=requests)
    for name, method in inspect.getmembers(client, inspect.ismethod):
        if name in {"send", "content", "close"} or name.startswith("_"):
            continue
        given = {
            "machine": "MACHINE", "map_id": 7, "version": 7, "etag": None, "readings": {"time": 0},
            "settings": {}, "changes": {}, "error_map": {}, "assignment": {}, "observations": [],
            "temperatures_c": {}, "question": {}, "lines": {}, "measurement": {}, "plan": {},
            "verification": {}, "verification_id": 7, "analysis_id": 7, "verifications": [],
            "versions": [], "controller": "CONTROLLER", "time": 0, "since": 0, "until": 0,
            "visit": 7, "name": "7", "role": "viewer", "path": tmp_path / "map.csv",
        }  # fmt: skip
        needed = inspect.signature(method).parameters
        for by in METHODS if name == "measure" else [None]:
            with suppress(UnexpectedAnswerError):
                found = method(**{k: v for k, v in (given | {"method": by}).items() if k in needed})
                if name.startswith("follow"):
                    next(found)  # an answer that is no stream
    with suppress(UnexpectedAnswerError):
        client.events()  # of all machines
    client.close()
    spoken = {
        f"{r.method} {r.url.path}".replace("MACHINE", "{}")
        .replace("CONTROLLER", "{}")
        .replace("7", "{}")
        for r in requests
    }
    assert spoken == described


async def test_both_clients_have_the_same_methods_and_words():
    def public(kind):
        return {n: m for n, m in vars(kind).items() if not n.startswith("_") and callable(m)}

    blocking, awaiting = public(ThermapClient), public(AsyncThermapClient)
    assert blocking.keys() - {"close"} == awaiting.keys() - {"aclose"}
    for name in blocking.keys() - {"close"}:
        assert inspect.getdoc(awaiting[name]) == inspect.getdoc(blocking[name])
        own, other = (inspect.signature(kind[name]) for kind in (awaiting, blocking))
        assert own.parameters == other.parameters
        assert str(own.return_annotation).removeprefix("Async") == str(other.return_annotation)


# -- errors --------------------------------------------------------------------------------


async def test_an_unknown_thing_is_told_with_what_exists(client):
    with pytest.raises(UnknownThingError, match="mcfv5050") as caught:
        await client.machine("nope")
    assert caught.value.status == 404


async def test_a_conflict(client):
    with pytest.raises(ConflictError, match="Run #1") as caught:
        await client.store_error_map("mcfv5050", error_map("Run #1", 21.0))
    assert caught.value.status == 409


async def test_invalid_content_says_which_field(client):
    with pytest.raises(InvalidContentError) as caught:
        await client.compensation("mcfv5050", {"x-middle": float("nan")})
    assert [e.field for e in caught.value.errors] == ["temperatures_c.x-middle"]
    with pytest.raises(InvalidContentError, match="repeatability_um"):
        # NaN must not become null, which this field may be.
        await client.store_error_map("mcfv5050", error_map("x", 26.0, repeatability_um=np.nan))


async def test_the_sentence_names_fields_that_the_detail_does_not(client):
    with pytest.raises(InvalidContentError) as caught:
        await client.compensation("mcfv5050", {"nowhere": 20.0})
    assert caught.value.sentence == f"{caught.value.detail} (at temperatures_c.nowhere)"


@both_clients
async def test_too_large(client):
    many = error_map("large", 26.0, instrument="x" * 5_000_000)
    with pytest.raises(TooLargeError) as caught:
        await client.store_error_map("mcfv5050", many)
    assert caught.value.status == 413


async def test_nobody_listens():
    with listening("127.0.0.1", 0, "serve") as opened:
        url = url_of(opened)
    said = re.escape(f"no thermap at {url}: is `thermap serve` running there?")
    with (
        ThermapClient(url) as client,
        pytest.raises(NotListeningError, match=f"^{said}$") as caught,
    ):
        client.health()
    assert caught.value.status is None
    assert isinstance(caught.value, ServiceUnavailableError)
    async with AsyncThermapClient(url) as awaiting:
        with pytest.raises(NotListeningError, match=f"^{said}$"):
            await awaiting.health()


@pytest.mark.parametrize(
    ("error", "kind", "words"),
    [
        (httpx.ReadTimeout("slow"), ServiceUnavailableError, "no answer from http://localhost wit"),
        (
            httpx.ReadError("reset"),
            ServiceUnavailableError,
            "the connection to http://localhost bro",
        ),
        (httpx.ConnectError("Name not known"), NotListeningError, r"localhost \(Name not known\)"),
    ],
)
def test_no_answer(error, kind, words):
    with failing(error) as client, pytest.raises(kind, match=words):
        client.health()


async def test_a_plan_is_waited_for_longer_than_the_rest():
    def slow(request):
        raise httpx.ReadTimeout("slow", request=request)

    transport = httpx.MockTransport(slow)
    told = "within 600 s; it may still be at work$"
    with ThermapClient("http://localhost", timeout_s=2.0, transport=transport) as client:
        with pytest.raises(ServiceUnavailableError, match=told):
            client.plan_analysis("mcfv5050", {})
        with pytest.raises(ServiceUnavailableError, match="within 2 s"):
            client.analyses("mcfv5050")
    async with AsyncThermapClient("http://localhost", transport=transport) as awaiting:
        with pytest.raises(ServiceUnavailableError, match=told):
            await awaiting.plan_analysis("mcfv5050", {})


def test_the_limit_reaches_the_connection():
    seen = []

    def answer(request):
        seen.append(request.extensions["timeout"]["read"])
        return httpx.Response(200, json=[])

    with ThermapClient("http://localhost", transport=httpx.MockTransport(answer)) as client:
        client.content(loop_calls.plan_analysis("mcfv5050", {}))
        client.content(loop_calls.analyses("mcfv5050"))
    assert seen == [600.0, 30.0]


@pytest.mark.parametrize(
    ("status", "kind"),
    [
        (401, NotAllowedError),
        (403, NotAllowedError),
        (429, TooManyRequestsError),
        (503, ServiceUnavailableError),
        (507, ServiceUnavailableError),
        (500, UnexpectedAnswerError),
    ],
)
def test_problems_of_other_kinds(status, kind):
    response = httpx.Response(
        status,
        json={"detail": "the service's own words", "errors": [{"field": "a", "message": "b"}]},
        headers={"content-type": "application/problem+json"},
    )
    with answering(response) as client, pytest.raises(kind) as caught:
        client.machines()
    assert (caught.value.detail, caught.value.status) == ("the service's own words", status)
    assert (caught.value.errors[0].field, caught.value.errors[0].message) == ("a", "b")


@pytest.mark.parametrize(
    ("response", "kind"),
    [
        (httpx.Response(200, text="<html>hello</html>"), UnexpectedAnswerError),
        (httpx.Response(200, json={"some": "other service"}), UnexpectedAnswerError),
        (httpx.Response(404, json={"detail": "Not Found"}), UnexpectedAnswerError),
        (httpx.Response(301, headers={"location": "https://x"}), UnexpectedAnswerError),
        (httpx.Response(502, text="Bad Gateway"), ServiceUnavailableError),
        (httpx.Response(413, text="nginx"), TooLargeError),
    ],
)
def test_answers_that_are_not_thermaps(response, kind):
    with answering(response) as client, pytest.raises(kind, match="thermap") as caught:
        client.machines()
    assert isinstance(caught.value, ThermapClientError)


# -- what travels --------------------------------------------------------------------------


def test_fields_that_a_newer_service_adds_are_passed_over():
    answer = {"status": "ok", "version": "9", "mood": "fine"}
    with answering(httpx.Response(200, json=answer)) as client:
        assert client.health().version == "9"


def test_ids_are_quoted():
    requests = []
    with answering(httpx.Response(204), requests=requests) as client:
        client.delete_machine("mill 3/ö?x")
        with pytest.raises(ValueError, match="empty"):
            client.delete_machine("")
    assert [r.url.raw_path for r in requests] == [b"/v1/machines/mill%203%2F%C3%B6%3Fx"]


def test_long_lists_of_readings_travel_in_parts():
    requests = []
    stored = httpx.Response(201, json={"stored": 1, "duplicates": 2})
    lots = ({"time": i, "temperatures_c": {}} for i in range(20_001))
    with answering(stored, requests=requests) as client:
        done = client.store_readings("m", lots)
        assert client.store_readings("m", []).stored == 0
    assert (done.stored, done.duplicates) == (3, 6)
    assert [len(json.loads(r.content)) for r in requests] == [10_000, 10_000, 1]


def test_the_url_comes_from_the_environment(monkeypatch):
    monkeypatch.setenv("THERMAP_URL", "http://shop:9000/")
    assert ThermapClient().base_url == "http://shop:9000"
    monkeypatch.delenv("THERMAP_URL")
    assert ThermapClient().base_url == DEFAULT_URL
    assert ThermapClient("https://me:secret@shop").base_url == "https://shop"


@pytest.mark.parametrize("url", ["shop:8000", "ftp://shop", "http://", "/x"])
def test_a_url_that_is_none_is_refused(url):
    with pytest.raises(ValueError, match="expected a URL such as"):
        ThermapClient(url)


def test_no_proxy_stands_before_this_computer(monkeypatch, served_url):
    for name in ("HTTP_PROXY", "ALL_PROXY", "http_proxy"):
        monkeypatch.setenv(name, "http://127.0.0.1:9")
    monkeypatch.delenv("NO_PROXY", raising=False)
    with ThermapClient(served_url) as client:
        assert client.health().status == "ok"


def test_a_path_before_the_routes():
    requests = []
    answer = httpx.Response(200, json=[])
    with ThermapClient(
        "http://proxy/thermap/",
        transport=httpx.MockTransport(lambda r: requests.append(r) or answer),
    ) as client:
        assert client.machines() == []
    assert requests[0].url.path == "/thermap/v1/machines"
