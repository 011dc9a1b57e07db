"""The examples run, and say what they are meant to show."""

import asyncio
import json
from pathlib import Path

import matplotlib as mpl
import numpy as np
import pytest

from examples import close_the_loop as loop
from examples import step_diagonal_to_table as chain
from examples.linuxcnc import __main__ as on_linuxcnc
from examples.linuxcnc import controller
from scripts.running_demo import running_demo


@pytest.fixture(scope="module")
def compared(tmp_path_factory):
    return asyncio.run(chain.compare(tmp_path_factory.mktemp("example")))


@pytest.mark.slow
def test_from_diagonals_in_three_states_to_the_error_between_them(compared):
    """What is left between the states is what the readings' own noise amounts to."""
    assert [row.run for row in compared] == [2, 4, 5]
    for row in compared:
        assert row.before_um > 10.0
        assert row.after_um < 0.15 * row.before_um
        assert 0.3 * row.uncertainty_um < row.after_um < 1.7 * row.uncertainty_um


def test_a_comparison_takes_out_the_machine_as_a_whole_and_no_more():
    """One displacement and one turn."""
    points = np.random.default_rng(1).uniform(0, 500, (50, 3))
    x, y, z = points.T
    turned = np.stack([3.0 + 0.02 * z, -1.0 - 0.01 * z, 2.0 - 0.02 * x + 0.01 * y], axis=1)
    assert chain.rms_length(chain.without_rigid_motion(points, turned)) < 1e-9
    stretched = points * [0.01, 0.0, 0.0]
    assert chain.rms_length(chain.without_rigid_motion(points, stretched)) > 0.5


@pytest.mark.slow
def test_the_loop_is_closed_on_visits_of_which_nobody_knew(tmp_path):
    """A reversal, which twelve visits are enough for."""
    closed = asyncio.run(loop.close_the_loop(tmp_path, "backlash:constant", 12, 4))
    (component,) = closed.planted["components"]
    assert f"{component} has a reversal" in closed.summary
    assert closed.status == "confirmed"
    assert closed.after_um < 0.8 * closed.before_um
    assert component in closed.report


@pytest.mark.slow
def test_the_notebook_runs_from_its_first_cell_to_its_last(tmp_path, monkeypatch, capsys):
    mpl.use("Agg")
    notebook = Path(loop.__file__).parent / "notebook.ipynb"
    cells = json.loads(notebook.read_text(encoding="utf-8"))["cells"]
    codes = ["".join(cell["source"]) for cell in cells if cell["cell_type"] == "code"]
    assert all(cell["outputs"] == [] for cell in cells if cell["cell_type"] == "code")
    found = {}
    with running_demo(tmp_path) as url:
        monkeypatch.setenv("THERMAP_URL", url)
        for i, code in enumerate(codes):
            exec(compile(code, f"cell {i}", "exec"), found)
        found["client"].close()
    assert len(found["table"]) == 21
    assert [one.get_ylabel().split()[-1] for one in found["axes"]] == ["[µm]", "[µrad]", "[µm/m]"]
    assert found["look"].components == ["EXX"]
    assert "SXY" in capsys.readouterr().out


def test_without_linuxcnc_the_example_says_what_is_missing(monkeypatch):
    monkeypatch.setattr(controller, "LINUXCNC", None)
    with pytest.raises(SystemExit, match=r"is not installed: .* \(Debian 12: apt-get install"):
        on_linuxcnc.main()
