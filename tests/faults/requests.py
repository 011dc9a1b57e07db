"""What schemathesis makes of the OpenAPI document, sent to a service: right, wrong and absurd."""

from __future__ import annotations

import subprocess
import sys
import tempfile
from datetime import UTC, datetime, timedelta
from pathlib import Path

from tests.faults.service import Service
from tests.faults.writers import ROOM, big_map, client_of, make_machine, temperatures

CHECKS = (
    "not_a_server_error",
    "status_code_conformance",
    "content_type_conformance",
    "response_schema_conformance",
)

SETTINGS = """
[parameters]
machine = "mcfv5050"
map_id = [1, 2, 3]
version = [1, 2, 3]
verification_id = [1, 2]
analysis_id = [1]
controller = ["linuxcnc", "fanuc", "heidenhain", "siemens-cec", "csv", "etalon", "isg-csv"]
"""
"""Things that are there, so that most cases reach what is behind the names."""


def send_cases(
    database_url: str, *, cases: int, seed: int, phases: str = "coverage,fuzzing"
) -> int:
    """Send so many cases at random to a service on a new database.

    Parameters
    ----------
    phases
        schemathesis' own: `coverage` adds some thousand cases of its own choice.

    Returns
    -------
    int
        schemathesis' exit code: 0 where every answer was as the document says.
    """
    service = Service(database_url)
    try:
        furnish(service.url)
        return schemathesis(service.url, cases=cases, seed=seed, phases=phases)
    finally:
        service.end()


def furnish(url: str) -> None:
    """Store a machine with maps, readings, verifications and an analysis."""
    make_machine(url)
    now = datetime.now(UTC)
    with client_of(url) as client:
        for i, t_c in enumerate((18.0, 24.0, 30.0)):
            client.post(f"{ROOM}/error-maps", json=big_map(f"Run {i}", t_c)).raise_for_status()
        readings = [
            {"time": (now - timedelta(seconds=10 * i)).isoformat(), "temperatures_c": came}
            for i in range(60)
            for came in [temperatures(20.0 + 0.1 * i)]
        ]
        client.post(f"{ROOM}/readings", json=readings).raise_for_status()
        for number in range(2):
            observations = [
                {
                    "time": (now - timedelta(seconds=10 * i)).isoformat(),
                    "component": "EXX",
                    "position_mm": 10.0 * i,
                    "measured_um": 20.0 + number,
                }
                for i in range(20)
            ]
            content = {
                "label": f"check {number}",
                "repeatability_um": 1.0,
                "observations": observations,
            }
            client.post(f"{ROOM}/verifications", json=content).raise_for_status()
        client.post(f"{ROOM}/analyses", json={"verifications": [1, 2]}).raise_for_status()


def schemathesis(url: str, *, cases: int, seed: int, phases: str) -> int:
    """Run it; what fails is printed with the request that did it.

    Streams are left out, as they have no end, and so is deleting the machine that all is about.
    """
    with client_of(url) as client:
        paths = client.get("/openapi.json").json()["paths"]
    operations = sum(len(methods) for methods in paths.values())
    with tempfile.TemporaryDirectory() as folder:
        settings = Path(folder) / "schemathesis.toml"
        settings.write_text(SETTINGS, encoding="utf-8")
        return subprocess.run(
            [
                *(sys.executable, "-m", "schemathesis.cli", "--config-file", str(settings)),
                *("run", f"{url}/openapi.json", "--checks", ",".join(CHECKS)),
                *("--phases", phases, "--seed", str(seed), "--no-shrink"),
                *("--max-examples", str(max(1, cases // operations)), "--continue-on-failure"),
                *("--exclude-path-regex", "stream$", "--request-timeout", "120"),
                *("--exclude-operation-id", "delete_machine_route_v1_machines__machine__delete"),
                *("--suppress-health-check", "all", "--warnings", "off"),
            ],
            cwd=folder,
        ).returncode
