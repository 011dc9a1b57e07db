"""The image and the services around it: built as the Dockerfile says, started as both files say.

There is no engine here. The stage that builds runs, instruction by instruction, in a root of its
own; what it leaves is started in another, read-only one, by the user, with the variables and the
command that are named, and its health command asks it.
"""

import re
import shutil
import signal
import subprocess
import sys
import time
import tomllib
from contextlib import suppress
from pathlib import Path

import httpx
import pytest
import yaml
from packaging.requirements import Requirement
from packaging.specifiers import SpecifierSet
from packaging.utils import canonicalize_name
from packaging.version import Version
from sqlalchemy import make_url

import thermap
from tests.databases import reachable
from tests.image.container import Container, copy_context, packages_from, why_not
from tests.image.dockerfile import health_of, read_dockerfile, words_of

ROOT = Path(__file__).parents[2]
BUILD, IMAGE = read_dockerfile((ROOT / "Dockerfile").read_text(encoding="utf-8"))
SERVICES = yaml.safe_load((ROOT / "docker-compose.yml").read_text(encoding="utf-8"))
PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))
LOCKS = {name: (ROOT / name).read_text(encoding="utf-8") for name in (
    "requirements.lock", "requirements-build.lock",
)}  # fmt: skip

MADE_BY_WHO_STARTS_IT = {"./compose/prometheus.key", "./compose/mosquitto.passwd"}


def environment_of(name):
    """A service's variables as they are where nobody set any."""
    stated = SERVICES["services"][name]["environment"]
    return {key: re.sub(r"\$\{\w+:-([^}]*)\}", r"\1", value) for key, value in stated.items()}


def locked(lock, **environment):
    """The versions in a lock, by name, for this Python."""
    found = {}
    for line in re.findall(r"(?m)^(\S+==[^\\\n]+?) \\$", LOCKS[lock]):
        one = Requirement(line)
        if one.marker is None or one.marker.evaluate(environment):
            assert one.name not in found
            found[one.name] = Version(next(iter(one.specifier)).version)
    return found


def test_the_lock_is_of_what_the_project_asks_for():
    (extras,) = {
        tuple(re.findall(r"--extra (\S+)", line)) for line in LOCKS["requirements.lock"].split("\n")
        if "uv pip compile" in line
    }  # fmt: skip
    optional = PROJECT["project"]["optional-dependencies"]
    assert set(extras) == optional.keys() - {"test", "benchmark", "notebook"}
    asked = PROJECT["project"]["dependencies"] + [one for name in extras for one in optional[name]]
    for lock, needs in (
        ("requirements.lock", asked),
        ("requirements-build.lock", PROJECT["dependency-groups"]["build"]),
        ("requirements-build.lock", PROJECT["build-system"]["requires"]),
    ):
        for python in ("3.11", "3.12", "3.13"):
            have = locked(lock, python_version=python, python_full_version=f"{python}.1")
            for need in map(Requirement, needs):
                assert need.specifier.contains(have[need.name]), need


def test_a_lock_says_versions_and_hashes_and_nothing_of_where_it_was_made():
    for text in LOCKS.values():
        for words in text.partition("\n\n")[0].splitlines()[2:]:
            assert re.fullmatch(r"\S+==\S+( ; .+)? \\|    --hash=sha256:[0-9a-f]{64}( \\)?", words)


def test_what_runs_runs_without_rights_and_installs_nothing():
    assert not {"root", "0", "0:0"} & {IMAGE.the("USER")}
    assert BUILD.base == IMAGE.base
    assert words_of(IMAGE.the("ENTRYPOINT")) == ["thermap"]
    for command in map(words_of, BUILD.all_of("RUN") + IMAGE.all_of("RUN")):
        if "install" in command and "-r" in command:
            assert "--require-hashes" in command
    assert all("pip" not in words_of(one) for one in IMAGE.all_of("RUN"))
    for one in SERVICES["services"].values():
        command = " ".join([*one.get("command", []), *one.get("entrypoint", [])])
        assert not re.search(r"\b(sh|pip|apt|apk)\b", command)


def test_each_service_has_health_limits_and_comes_back():
    own = health_of(IMAGE)
    for name, one in SERVICES["services"].items():
        assert one["restart"] == "unless-stopped", name
        assert one["deploy"]["resources"]["limits"].keys() == {"cpus", "memory", "pids"}, name
        assert "build" in one or re.search(r":v?\d", one["image"]), name
        health = one.get("healthcheck", {}).get("test", ["CMD", *own])
        assert health[0] == "CMD", name
        assert "curl" not in health, name
        for port in one.get("ports", []):
            assert port.startswith("127.0.0.1:"), name
        for volume in one.get("volumes", []):
            source = volume.split(":")[0]
            if not source.startswith("./"):
                assert source in SERVICES["volumes"]
            elif source not in MADE_BY_WHO_STARTS_IT:
                assert (ROOT / source).is_file(), source
        for needed in one.get("depends_on", {}):
            assert needed in SERVICES["services"]
    assert "--insecure" not in (ROOT / "docker-compose.yml").read_text(encoding="utf-8")
    for name in ("thermap", "worker", "mosquitto"):
        assert SERVICES["services"][name]["read_only"] is True
    assert SERVICES["services"]["thermap"]["command"] == words_of(IMAGE.the("CMD"))
    # Only who asks for it by a profile has more than the service and its database.
    plain = {name for name, one in SERVICES["services"].items() if "profiles" not in one}
    assert plain == {"thermap", "database"}


def test_prometheus_asks_the_service_where_it_is_with_the_rules_that_it_has(tmp_path):
    settings = yaml.safe_load((ROOT / "compose/prometheus.yml").read_text(encoding="utf-8"))
    (job,) = settings["scrape_configs"]
    (target,) = job["static_configs"][0]["targets"]
    name, port = target.split(":")
    assert port == IMAGE.environment["THERMAP_PORT"]
    assert name in SERVICES["services"]["thermap"]["environment"]["THERMAP_ALLOWED_HOSTS"]
    places = {
        volume.split(":")[1]: volume.split(":")[0]
        for volume in SERVICES["services"]["prometheus"]["volumes"]
    }
    for file in (*settings["rule_files"], job["authorization"]["credentials_file"]):
        assert f"/etc/prometheus/{file}" in places
    if shutil.which("promtool"):
        for target in ("prometheus.yml", "alerts.yml"):
            shutil.copy(ROOT / places[f"/etc/prometheus/{target}"], tmp_path / target)
        (tmp_path / "thermap.key").write_text("key")
        subprocess.run(
            ["promtool", "check", "config", tmp_path / "prometheus.yml"], check=True,
            capture_output=True,
        )  # fmt: skip


@pytest.fixture
def image(tmp_path):
    """The image's root as the Dockerfile builds it: a function that makes its containers."""
    if reason := why_not():
        pytest.skip(reason)
    # What pytest makes is closed to others.
    for parent in (tmp_path, *tmp_path.parents[:2]):
        parent.chmod(parent.stat().st_mode | 0o011)
    folder = tmp_path / "image"
    context, root = folder / "context", folder / "root"
    for made in (folder, context, root):
        made.mkdir()
    copy_context(ROOT, context, (ROOT / ".dockerignore").read_text(encoding="utf-8"))
    opened = {name: folder / name.strip("/").replace("/", "-") for name in (
        "/source", "/opt/thermap", "/opt/builder", "/wheel",
    )}  # fmt: skip
    builder = Container(root)
    for target, source in opened.items():
        source.mkdir()
        builder.add(source, target, writable=True)
    for instruction, arguments in BUILD.instructions:
        if instruction == "COPY":
            *sources, target = arguments.split()
            for source in sources:
                place = opened["/source"] / (source if target == "./" else target)
                copy = shutil.copytree if (context / source).is_dir() else shutil.copy
                copy(context / source, place)
        elif instruction == "RUN":
            code, out, err = builder.run(
                words_of(arguments),
                packages_from() | {"PATH": "/usr/local/bin:/usr/bin:/bin"} | BUILD.environment,
                folder=BUILD.the("WORKDIR"),
            )
            assert code == 0, (arguments, out[-2000:], err[-2000:])
    copied = [one.split() for one in IMAGE.all_of("COPY")]
    assert copied == [["--from=build", "/opt/thermap", "/opt/thermap"]]

    def container(data):
        made = Container(root)
        made.add(opened["/opt/thermap"], "/opt/thermap")
        made.add(data, IMAGE.the("VOLUME"), writable=True)
        return made

    return container


def new_volume(folder):
    """Make a volume as the image does."""
    (made,) = IMAGE.all_of("RUN")
    *install, target = words_of(made)
    assert target == IMAGE.the("VOLUME")
    subprocess.run([*install, folder], check=True)
    return folder


class Started:
    """A container of the image, as one of the services that are named."""

    def __init__(self, container, port, name="thermap", **environment):
        self.environment = IMAGE.environment | environment | {"THERMAP_PORT": str(port)}
        self._container = container
        self.url = f"http://127.0.0.1:{port}"
        stated = SERVICES["services"][name]
        self._health = stated.get("healthcheck", {}).get("test", ["CMD", *health_of(IMAGE)])[1:]
        self.process = container.start(
            [*words_of(IMAGE.the("ENTRYPOINT")), *stated["command"]],
            self.environment,
            **self._whose(),
        )

    def _whose(self):
        return {"user": IMAGE.the("USER"), "folder": IMAGE.the("WORKDIR")}

    def wait(self):
        """Wait until it answers; where it ends instead, its words are why."""
        deadline = time.monotonic() + 120.0
        while time.monotonic() < deadline:
            assert self.process.poll() is None, self.process.communicate()
            with suppress(httpx.TransportError):
                httpx.get(f"{self.url}/healthz", trust_env=False).raise_for_status()
                return
            time.sleep(0.05)
        raise AssertionError(f"nothing at {self.url}: {self.end()}")

    def run(self, *words):
        """Run a command in it, as `docker compose exec` does."""
        if self.process.poll() is not None:  # in another one, which sees the same volume
            return self._container.run(words, self.environment, **self._whose())
        return self._container.enter(self.process, words, self.environment, **self._whose())

    def is_well(self):
        """Whether its health command says so."""
        return self.run(*self._health)[0] == 0

    def end(self):
        """Stop it as an engine does, and give its code and what it wrote."""
        self.process.send_signal(signal.SIGTERM)
        out, err = self.process.communicate(timeout=60)
        return self.process.returncode, out, err


@pytest.fixture
def started():
    """Start containers that are gone at the end."""
    made = []

    def start(*arguments, **environment):
        made.append(Started(*arguments, **environment))
        return made[-1]

    yield start
    for one in made:
        one.process.kill()
        one.process.communicate()


@pytest.mark.slow
@pytest.mark.begin
def test_it_is_built_and_starts_as_the_files_say(
    image, tmp_path, started, databases, free_tcp_port
):
    """One test, as building takes a minute or two."""
    container = image(new_volume(tmp_path / "unused"))
    expect_what_is_locked(container)

    data = new_volume(tmp_path / "alone")
    service = started(image(data), free_tcp_port)
    expect_service_that_asks_for_keys(service, host="127.0.0.1")
    assert (data / "thermap.db").stat().st_uid == int(IMAGE.the("USER").split(":")[0])

    stated = environment_of("thermap")
    assert make_url(stated["THERMAP_DATABASE_URL"]).host in SERVICES["services"]
    url = reachable(databases.empty, "postgresql")
    data = new_volume(tmp_path / "beside-postgresql")
    service = started(image(data), free_tcp_port, **stated | {"THERMAP_DATABASE_URL": url})
    expect_service_that_asks_for_keys(service, host=stated["THERMAP_ALLOWED_HOSTS"])
    assert [file.name for file in data.iterdir()] == ["friday.thermap"]
    expect_worker_that_says_whether_it_lives(
        started(
            image(new_volume(tmp_path / "worker")), free_tcp_port, "worker",
            **environment_of("worker") | {"THERMAP_DATABASE_URL": url},
        )
    )  # fmt: skip
    databases.give_back(url)


def expect_what_is_locked(container):
    """The environment has the locked versions, this thermap, and nothing else."""
    code, out, err = container.run(
        ["python", "-m", "pip", "freeze", "--all"], IMAGE.environment, user=IMAGE.the("USER")
    )
    assert code == 0, err
    installed = {one.name: one for one in map(Requirement, out.splitlines())}
    for tool in ("pip", "setuptools"):
        installed.pop(tool, None)
    assert installed.pop("thermap").specifier == SpecifierSet(f"=={thermap.__version__}")
    found = {
        canonicalize_name(name): Version(next(iter(one.specifier)).version)
        for name, one in installed.items()
    }
    assert found == locked("requirements.lock")


def expect_service_that_asks_for_keys(service, host):
    """It is well, keeps others out, writes nothing beside its volume, and ends when it is told."""
    service.wait()
    assert service.is_well()
    for elsewhere in ("/here", "/opt/thermap/here", "/usr/here"):
        assert service.run("touch", elsewhere)[0] != 0, elsewhere
    code, _, err = service.run("thermap", "backup", "/data/friday.thermap")
    assert code == 0, err
    code, key, err = service.run("thermap", "keys", "create", "prometheus", "--role", "viewer")
    assert code == 0, err
    with httpx.Client(base_url=service.url, headers={"Host": host}, trust_env=False) as client:
        assert client.get("/metrics").status_code == 401
        asked = client.get("/metrics", headers={"Authorization": f"Bearer {key.strip()}"})
        assert asked.status_code == 200, asked.text
    code, out, err = service.end()
    assert code == 0, err
    assert re.search(r"key \(admin\) +\S{20}", out), out
    assert not service.is_well()


def expect_worker_that_says_whether_it_lives(worker):
    """It is well while it runs, ends when it is told, and is not well then."""
    deadline = time.monotonic() + 120.0
    while not worker.is_well():
        assert worker.process.poll() is None, worker.process.communicate()
        assert time.monotonic() < deadline, "it is never well"
        time.sleep(0.1)
    code, out, err = worker.end()
    assert code == 0, err
    assert "runs 1 analysis at a time" in out
    assert not worker.is_well()


def test_this_python_is_the_images():
    version = ".".join(map(str, sys.version_info[:2]))
    if version != "3.11":
        pytest.skip(f"the image has another Python than this {version}")
    assert IMAGE.base.startswith(f"python:{version}-")
