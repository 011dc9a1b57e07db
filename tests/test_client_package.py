"""The package that users import: what it is generated from, what it loads, and its distribution."""

import json
import subprocess
import sys
import venv
import zipfile
from datetime import UTC, datetime
from importlib.metadata import distribution
from pathlib import Path

import pytest
from packaging.requirements import Requirement

import thermap
from app.cli.listening import listening, serving, url_of
from app.geometry.components import COMPONENTS
from scripts.openapi_document import openapi_document
from tests.service_examples import furnish_database, running
from thermap import answers
from thermap.shape import Shape
from thermap.table import Components

PACKAGE = Path(thermap.__file__).parent
ROOT = PACKAGE.parent
OF_THE_CLIENT = {"httpx", "pydantic"}

# -- generated -----------------------------------------------------------------------------


COMMON = {"ModelChange", "VerificationExtent", "AnsweredClaim", "ControllerHead"}
"""What several answers have in common; it is published in each of them."""


def test_every_shape_has_the_fields_that_are_published():
    published = openapi_document()["components"]["schemas"]
    shapes = {
        name: kind
        for name, kind in vars(answers).items()
        if isinstance(kind, type)
        and issubclass(kind, Shape)
        and kind.__module__ == answers.__name__
    }
    assert shapes.keys() - published.keys() <= COMMON, REWRITE
    for name in shapes.keys() & published.keys():
        shape, schema = shapes[name], published[name]
        fields = {has.alias or field: has for field, has in shape.model_fields.items()}
        assert fields.keys() == schema["properties"].keys(), f"{name}: {REWRITE}"
        required = {field for field, has in fields.items() if has.is_required()}
        assert required == set(schema.get("required", ())), f"{name}: {REWRITE}"


REWRITE = "run `python -m scripts.write_client` and look at the difference"


@pytest.mark.slow
def test_the_generated_modules_are_what_the_script_writes():
    from scripts.write_client import write_blocking, write_shapes

    for name, text in {**write_blocking(), **write_shapes(openapi_document())}.items():
        assert (PACKAGE / name).read_text(encoding="utf-8") == text, f"{name}: {REWRITE}"


@pytest.mark.parametrize("code", COMPONENTS)
def test_an_entry_knows_its_unit_whichever_fields_that_names(code):
    component = COMPONENTS[code]
    numbers = [-1.0, -2.0] if component.is_table else -1.0
    fields = dict.fromkeys(("sensor", "temperature_c", "lower_map", "upper_map", "weight", "axis"))
    fields |= {"component": code, "chapter": "", "status": "interpolated", "effects": []}
    of_table = answers.ComponentCompensationAnswer(**fields, **{component.error_field: numbers})
    of_map = answers.ComponentAnswer(component=code, **{component.input_field: numbers})
    for entry in (of_table, of_map):
        assert entry.unit == component.unit.symbol
        assert entry.errors == numbers
        assert entry.compensation == ([1.0, 2.0] if component.is_table else 1.0)
        assert entry.standard_errors is None
        sure = entry.model_copy(update={component.standard_error_field: [0.1, 0.2]})
        assert sure.standard_errors == [0.1, 0.2]


def test_an_answer_with_all_fields_of_another_is_one_of_it():
    assert issubclass(answers.CurrentCompensationAnswer, answers.CompensationAnswer)
    assert issubclass(answers.StepDiagonalAnswer, answers.MeasurementAnswer)
    assert issubclass(answers.AccuracyAnswer, answers.AnswerHead)
    assert issubclass(answers.ChangedModelAnswer, (answers.ModelAnswer, answers.ModelChange))
    assert issubclass(answers.ErrorMapAnswer, (answers.ModelChange, Components))


# -- its own distribution ------------------------------------------------------------------


def distributions(names):
    """Name the distributions and all that they need."""
    found = set()
    waiting = list(names)
    while waiting:
        name = waiting.pop()
        if name not in found:
            found.add(name)
            for stated in distribution(name).requires or ():
                needed = Requirement(stated)
                if needed.marker is None or needed.marker.evaluate({"extra": ""}):
                    waiting.append(needed.name)
    return found


def link_distributions(site_packages, names):
    """Put installed distributions into another environment; give the modules that they are."""
    modules = set()
    for name in names:
        for file in distribution(name).files:
            top = file.parts[0]
            if top in ("..", "__pycache__"):
                continue
            modules.add(top.split(".")[0])
            target = site_packages / top
            if not target.exists():
                target.symlink_to(Path(distribution(name).locate_file(top)))
    return modules


@pytest.fixture(scope="module")
def installed(tmp_path_factory):
    """A new environment with the client's wheel and what it needs: its python, the modules."""
    folder = tmp_path_factory.mktemp("installed")
    subprocess.run(
        [sys.executable, "-m", "hatchling", "build", "-t", "wheel", "-d", str(folder)],
        cwd=ROOT / "distributions" / "thermap-client", check=True, capture_output=True,
    )  # fmt: skip
    (wheel,) = folder.glob("*.whl")
    venv.create(folder / "environment", with_pip=False, symlinks=True)
    (site_packages,) = folder.glob("environment/lib/python*/site-packages")
    with zipfile.ZipFile(wheel) as packed:
        packed.extractall(site_packages)
    metadata = next(site_packages.glob("thermap_client-*/METADATA")).read_text(encoding="utf-8")
    needed = [
        Requirement(line.removeprefix("Requires-Dist: "))
        for line in metadata.splitlines()
        if line.startswith("Requires-Dist: ")
    ]
    assert {one.name for one in needed if one.marker is None} == OF_THE_CLIENT
    assert {p.name for p in site_packages.iterdir() if p.is_dir()} == {
        "thermap",
        f"thermap_client-{thermap.__version__}.dist-info",
    }
    modules = link_distributions(site_packages, distributions(OF_THE_CLIENT)) | {"thermap"}
    return folder / "environment" / "bin" / "python", modules


USER = """
import asyncio, json, sys
import app
from thermap import AsyncThermapClient, ThermapClient, UnknownThingError

assert app.MINE
url, machine, time = sys.argv[1:]


class Array:
    def tolist(self):
        return [[0.0, 0.0, 0.0]]


with ThermapClient(url) as client:
    first = client.store_readings(machine, {"time": time, "temperatures_c": {"x-middle": 24.0}})
    table = client.compensation(machine, {"x-middle": 24.0, "z-column": 26.0})
    try:
        client.machine("nope")
    except UnknownThingError as error:
        refused = error.status
    try:
        client.volumetric_error(machine, {"points_mm": Array()})
    except ImportError as error:
        without_numpy = str(error)


async def ask():
    async with AsyncThermapClient(url) as client:
        again = await client.compensation(machine, {"x-middle": 24.0, "z-column": 26.0})
        turn = {"order": "C", "angles_deg": {"C": [0.0]}, "points_mm": Array()}
        state = {"temperatures_c": {"x-middle": 24.0, "z-column": 26.0}}
        body = state | turn | {"missing_components": "zero"}
        return again, await client.rotary_axis_error(machine, body)


again, turned = asyncio.run(ask())
found = {
    "stored": first.stored,
    "entries": [(e.component, e.compensation, e.unit) for e in table.components],
    "same": again.components == table.components,
    "turned": len(turned.errors_um),
    "refused": refused,
    "without_numpy": without_numpy,
    "modules": sorted(sys.modules),
}
print(json.dumps(found))
"""


@pytest.mark.slow
@pytest.mark.parametrize("place", ["app.py", "app/__init__.py"])
def test_it_works_beside_a_users_own_app(installed, databases, tmp_path, place):
    python, allowed = installed
    (tmp_path / place).parent.mkdir(exist_ok=True)
    (tmp_path / place).write_text("MINE = True\n")
    (tmp_path / "user.py").write_text(USER)
    now = datetime.now(UTC)
    database_url = databases.prepared("sqlite", furnish_database)
    with (
        running(database_url, lambda: now) as service,
        listening("127.0.0.1", 0, "serve") as opened,
        serving(service, opened, "warning"),
    ):
        done = subprocess.run(
            [python, "user.py", url_of(opened), "mcfv5050", now.isoformat()],
            cwd=tmp_path, env={}, capture_output=True, text=True, timeout=120,
        )  # fmt: skip
    databases.give_back(database_url)
    assert done.returncode == 0, done.stderr
    found = json.loads(done.stdout)
    assert (found["stored"], found["same"], found["turned"], found["refused"]) == (1, True, 1, 404)
    # At Run #3: EXX is 4·x/100 µm at 0, 100 and 500 mm.
    assert found["entries"][0] == ["EXX", [0.0, -4.0, -20.0], "µm"]
    assert 'pip install "thermap-client[numpy]"' in found["without_numpy"]
    roots = {module.split(".")[0] for module in found["modules"]}
    beyond = roots - allowed - set(sys.stdlib_module_names) - {"__main__", "__mp_main__", "app"}
    # Some systems' Python has a `sitecustomize` of its own.
    assert {root for root in beyond - {"sitecustomize"} if not root.startswith("_")} == set()
    assert [module for module in found["modules"] if module.startswith("app.")] == []


TYPED = """
from datetime import datetime

from thermap import AsyncThermapClient, ThermapClient


def now(client: ThermapClient) -> list[tuple[str, datetime, float | None]]:
    tagged = client.current_table("vmc")
    assert tagged is not None
    return [(e.component, tagged.table.reading_time, e.weight) for e in tagged.table.components]


def by_name(client: ThermapClient) -> tuple[str | None, float | None, list[str]]:
    table, stored = client.compensation("vmc", {}), client.error_map("vmc", 1)
    return table["EXX"].sensor, stored["SXY"].value_um_per_m, list(table)


async def status(client: AsyncThermapClient) -> bool:
    return (await client.analysis("vmc", 1)).status == "done"
"""
WRONG = {
    "client.machine(1)": "arg-type",
    "number: int = client.machine('vmc').name": "assignment",
    "client.health().mood": "attr-defined",
    "client.error_map('vmc', 1)['EXX'].weight": "attr-defined",
    "client.analysis('vmc', 1).status == 'finished'": "comparison-overlap",
}


@pytest.mark.slow
def test_a_users_types_are_checked(installed, tmp_path):
    python, _ = installed
    lines = "".join(f"    {line}\n" for line in WRONG)
    (tmp_path / "right.py").write_text(TYPED)
    (tmp_path / "wrong.py").write_text(
        f"from thermap import ThermapClient\n\ndef wrong(client: ThermapClient) -> None:\n{lines}"
    )
    checked = subprocess.run(
        [sys.executable, "-m", "mypy", "--strict", "--config-file=", "--no-incremental",
         "--python-executable", str(python), "right.py", "wrong.py"],
        cwd=tmp_path, env={"PATH": ""}, capture_output=True, text=True, timeout=300,
    )  # fmt: skip
    errors = [line for line in checked.stdout.splitlines() if ": error: " in line]
    assert all(line.startswith("wrong.py:") for line in errors), checked.stdout
    assert [line.rsplit("[", 1)[1] for line in errors] == [f"{kind}]" for kind in WRONG.values()]
