"""Body diagonals as they are measured: Ed, ESd, reversal, squareness and what hides in it."""

import numpy as np
import pytest

from app.errors import InvalidContent
from app.geometry.body_diagonal import DIAGONALS, diagonal_accuracy
from app.geometry.chain import Chain
from app.geometry.components import COMPONENTS, Kind
from app.geometry.error_table import Table
from app.geometry.work_volume import WorkVolume
from app.measurement.body_diagonal import body_diagonal
from app.measurement.step_diagonal_readings import step_diagonal_readings
from tests.geometry.example_fields import (
    RIGID,
    constant_field,
    diagonal_displacements,
    random_field,
)
from tests.measurement.step_diagonal_example import (
    ORIGIN,
    SQUARENESS,
    STEP,
    STEPS,
    TRANSLATIONS,
    WAYS,
    derive,
    errors_of,
    expected_errors,
    field_of,
    nodes,
    random_tables,
)

ENDS = list(zip(ORIGIN, ORIGIN + STEP * STEPS, strict=True))
BOX = WorkVolume(*ENDS)
SIDES = STEP * STEPS
R = BOX.diagonal_mm

# What the text below 8.111 lists for ppp, as signs of a squareness' pattern: EBX with
# +ac/r is as SZX, ECX with −ab/r as −SXY. For XYZF with the signs that 8.80-8.82 give.
HIDDEN = {
    "FXYZ": {"SXY": {"ECX": -1}, "SYZ": {"EAY": -1}, "SZX": {"EBX": 1, "EBY": 1}},
    "XFYZ": {"SXY": {}, "SYZ": {"EAY": -1}, "SZX": {"EBY": 1}},
    "XYFZ": {"SXY": {"ECX": 1}, "SYZ": {"EAX": -1}, "SZX": {}},
    "XYZF": {"SXY": {"ECX": 1}, "SYZ": {"EAY": 1}, "SZX": {"EBX": -1, "EBY": -1}},
}
ANGULAR = [code for code, c in COMPONENTS.items() if c.kind is Kind.ANGULAR]


def one_run(field, steps=10, box=BOX):
    along = np.linspace(0.0, box.diagonal_mm, steps + 1)
    read = diagonal_displacements(field, box, steps)
    return {d: {"positions_mm": along, "forward_um": values} for d, values in read.items()}


def values_of(found):
    return {t.component.code: float(t.errors[0]) for t in found.result.tables}


def test_ranges_are_those_of_the_projected_errors():
    field = random_field("XYFZ", RIGID, seed=61)
    found = body_diagonal(one_run(field), volume=BOX)
    expected = diagonal_accuracy(diagonal_displacements(field, BOX, 10))
    assert (found.ed_um, found.esd_um) == (expected.ed_um, expected.esd_um)
    figures = found.result.figures
    assert (figures["ed_um"], figures["esd_um"]) == (expected.ed_um, expected.esd_um)
    assert figures["range_pnp_um"] == expected.ranges_um["pnp"]


def test_squareness_is_found_beside_scales_and_end_point_slopes():
    tables = random_tables(62, [*TRANSLATIONS, *SQUARENESS])
    found = values_of(body_diagonal(one_run(field_of(tables)), volume=BOX))
    expected = expected_errors(tables, "end-points")
    for code in SQUARENESS:
        assert found[code] == pytest.approx(expected[code], abs=1e-9)


def test_it_agrees_with_the_step_diagonals_of_the_same_readings():
    """Also with noise: end-point squareness of both is made of the same four ends."""
    rng = np.random.default_rng(63)
    field = field_of(random_tables(63, [*TRANSLATIONS, *SQUARENESS, "EBX", "EAY"]))
    read = step_diagonal_readings(field, ORIGIN, STEP, STEPS, noise_um=1.0, rng=rng)
    along = np.linspace(0.0, R, STEPS + 1)
    runs = {
        d: {"positions_mm": along, "forward_um": np.r_[0.0, rows[:, 2]]} for d, rows in read.items()
    }
    found = body_diagonal(runs, volume=BOX)
    steps = derive(read)
    for code in SQUARENESS:
        assert values_of(found)[code] == pytest.approx(errors_of(steps)[code][0], abs=1e-9)
    assert found.result.figures["diagonal_scale_um_per_m"] == pytest.approx(
        steps.result.figures["diagonal_scale_um_per_m"]
    )


def test_four_ends_cannot_tell_the_scales_apart():
    """Six errors, four numbers: a longer x with a shorter y of the right size is not seen."""
    columns = []
    for code in ("EXX", "EYY", "EZZ", *SQUARENESS):
        table = Table((), 10.0) if code in SQUARENESS else Table(nodes(code[2]), nodes(code[2]))
        read = diagonal_displacements(field_of({code: table}), BOX, 1)
        columns.append([read[d][-1] for d in DIAGONALS])
    assert np.linalg.matrix_rank(np.array(columns).T, tol=1e-9) == 4
    assert np.linalg.matrix_rank(np.array(columns[:3]).T, tol=1e-9) == 1
    longer = Table(nodes("x"), 0.02 * (nodes("x") - ORIGIN[0]))
    shorter = Table(nodes("y"), -0.02 * (SIDES[0] / SIDES[1]) ** 2 * (nodes("y") - ORIGIN[1]))
    found = body_diagonal(one_run(field_of({"EXX": longer, "EYY": shorter})), volume=BOX)
    assert found.esd_um < 1e-9
    assert any(note.startswith("Four ends answer four questions") for note in found.result.notes)


@pytest.mark.parametrize("code", ANGULAR)
@pytest.mark.parametrize("chain", HIDDEN)
def test_rotations_that_do_not_change_count_as_the_squareness_that_the_text_lists(chain, code):
    found = values_of(body_diagonal(one_run(constant_field(chain, {code: 12.0})), volume=BOX))
    for square, hidden in HIDDEN[chain].items():
        assert found[square] == pytest.approx(12.0 * hidden.get(code, 0), abs=1e-9)


@pytest.mark.parametrize("chain", HIDDEN)
def test_the_note_says_which_rotations_hide_in_the_squareness(chain):
    found = body_diagonal(one_run(field_of({}, chain)), volume=BOX, chain=Chain.parse(chain))
    (note,) = [n for n in found.result.notes if n.startswith("On the diagonals of")]
    said = [
        square + "".join(f" {'+' if sign > 0 else '−'} {code}" for code, sign in hidden.items())
        for square, hidden in HIDDEN[chain].items()
    ]
    assert note.endswith(f"what is given is {', '.join(said)}.")


@pytest.mark.parametrize("chain", HIDDEN)
@pytest.mark.parametrize("code", ANGULAR)
def test_of_a_rotation_that_changes_the_mean_of_both_ends_counts(chain, code):
    """About the centre of the volume, where the lines are along which the axes are measured."""
    box = WorkVolume(*((-side / 2, side / 2) for side in SIDES))
    half = SIDES["XYZ".index(code[2])] / 2
    table = Table([-half, 0.0, half], [-5.0, 80.0, 19.0])
    found = values_of(body_diagonal(one_run(field_of({code: table}, chain), box=box), volume=box))
    for square, hidden in HIDDEN[chain].items():
        # Arms at both ends are ± the same, a workpiece-side axis' own one too.
        expected = 7.0 * hidden.get(code, 0)
        assert found[square] == pytest.approx(expected, abs=1e-9)


def test_a_measured_part_of_the_diagonal_will_do():
    """Reflectors seldom reach the corners: the slope counts over what was measured."""
    field = field_of({"SXY": Table((), 10.0), "SZX": Table((), -4.0)})
    runs = one_run(field, 10)
    part = {
        d: {"positions_mm": r["positions_mm"][1:9] - 7.0, "forward_um": r["forward_um"][1:9]}
        for d, r in runs.items()
    }
    assert values_of(body_diagonal(part, volume=BOX)) == pytest.approx(
        {"SXY": 10.0, "SYZ": 0.0, "SZX": -4.0}, abs=1e-9
    )


def test_both_directions_by_hand():
    """Ed of ISO 230-6 is of both directions: reversal of 2 µm widens the range."""
    level = {"positions_mm": [0.0, 100.0, 200.0], "forward_um": [0.0, 1.0, 3.0]}
    both = level | {
        "forward_um": [[5.0, 6.0, 8.0], [7.0, 8.0, 10.0]],
        "backward_um": [4.0, 5.0, 6.0],
    }
    found = body_diagonal({"ppp": both, "npp": level, "pnp": level, "ppn": level})
    # Means 6, 7, 9 forward and 4, 5, 6 backward; counted from the first forward mean.
    assert found.diagonals_um == {"ppp": 5.0, "npp": 3.0, "pnp": 3.0, "ppn": 3.0}
    assert (found.ed_um, found.esd_um) == (5.0, 5.0)
    assert found.reversal_um == {"ppp": 3.0}
    assert found.result.figures["bd_um"] == 3.0
    assert any("in one direction only (npp, pnp, ppn)" in note for note in found.result.notes)
    assert found.result.tables == ()
    assert any(note.startswith("No squareness") for note in found.result.notes)


@pytest.mark.slow
@pytest.mark.parametrize("backward", [True, False])
def test_standard_errors_are_those_of_many_measurements(backward):
    rng = np.random.default_rng(64)
    truth = one_run(field_of(random_tables(64, [*TRANSLATIONS, *SQUARENESS])), 8)
    drawn, noises = [], []
    for _ in range(400):
        runs = {}
        for d, r in truth.items():

            def noisy(count, values=r["forward_um"]):
                return values + rng.normal(scale=0.5, size=(count, values.size))

            runs[d] = r | {"forward_um": noisy(3)}
            if backward:
                runs[d]["backward_um"] = noisy(2)
        found = body_diagonal(runs, volume=BOX)
        drawn.append(list(values_of(found).values()))
        noises.append(found.repeatability_um)
    assert np.mean(np.square(noises)) == pytest.approx(0.25, rel=0.05)
    freedom = found.result.figures["degrees_of_freedom"]
    assert freedom == 4 * (3 if backward else 2) * 8
    assert 2 * 0.25**2 / np.var(np.square(noises)) == pytest.approx(freedom, rel=0.3)
    stated = np.array([t.standard_errors[0] for t in found.result.tables]) * 0.5 / noises[-1]
    np.testing.assert_allclose(np.std(drawn, axis=0), stated, rtol=0.12)


def test_a_stated_repeatability_counts_where_runs_are_not_repeated():
    found = body_diagonal(one_run(field_of({})), volume=BOX, repeatability_um=0.4)
    (sxy, *_) = found.result.tables
    # Four ends of two readings each: √8 · 0.4 µm, over 4 XY/R.
    expected = 0.4 * 8**0.5 * R / (4 * SIDES[0] * SIDES[1]) * 1000.0
    assert sxy.standard_errors[0] == pytest.approx(expected)
    silent = body_diagonal(one_run(field_of({})), volume=BOX)
    assert silent.repeatability_um is None
    assert silent.result.tables[0].covariance is None
    assert any(note.startswith("No uncertainty") for note in silent.result.notes)


def repeated(runs, zeros, noise_um=0.0):
    """The same run again and again, each with another zero and with new noise."""
    rng = np.random.default_rng(66)
    found = {}
    for name, r in runs.items():
        noise = rng.normal(scale=noise_um, size=(len(zeros), len(r["forward_um"])))
        found[name] = r | {"forward_um": r["forward_um"] + np.array(zeros)[:, None] + noise}
    return found


def test_a_zero_of_each_run_is_no_noise():
    runs = one_run(field_of(random_tables(65, TRANSLATIONS)))
    plain, moved = (
        body_diagonal(repeated(runs, zeros, 0.5)) for zeros in ([0.0] * 3, [0.0, 30.0, -12.0])
    )
    assert moved.repeatability_um == pytest.approx(plain.repeatability_um)


def test_runs_that_do_not_differ_leave_the_noise_unknown():
    runs = repeated(one_run(field_of(random_tables(65, TRANSLATIONS))), [0.0, 30.0, -12.0])
    silent = body_diagonal(runs, volume=BOX)
    assert silent.repeatability_um is None
    assert silent.result.tables[0].covariance is None
    assert any("do not differ" in note for note in silent.result.notes)
    assert body_diagonal(runs, volume=BOX, repeatability_um=0.3).repeatability_um == 0.3


def test_small_readings_may_be_in_mm():
    runs = one_run(field_of({"SXY": Table((), 0.05)}))
    notes = body_diagonal(runs, volume=BOX).result.notes
    assert sum("may be in mm instead of µm" in note for note in notes) == 4


RIGHT = {d: {"positions_mm": [0.0, 200.0, 400.0], "forward_um": [0.0, 1.0, 2.0]} for d in WAYS}


def wrong(**changes):
    return RIGHT | {"pnp": RIGHT["pnp"] | changes}


@pytest.mark.parametrize(
    ("diagonals", "said"),
    [
        (
            {d: RIGHT[d] for d in ("ppp", "npp", "ppn")},
            "expected ppp, npp, pnp, ppn, got ppp, npp",
        ),
        (RIGHT | {"nnn": RIGHT["ppp"]}, "expected ppp, npp, pnp, ppn, got .*nnn"),
        (RIGHT | {"pnp": {"positions_mm": [0, 1]}}, "diagonals.pnp: expected .* forward_um"),
        (wrong(spread_um=[1.0]), "diagonals.pnp: expected positions_mm, forward_um"),
        (wrong(positions_mm=[0.0, 400.0, 200.0]), "pnp.positions_mm: expected at least two incr"),
        (wrong(positions_mm=[0.0]), "pnp.positions_mm: expected at least two increasing"),
        (wrong(positions_mm=[0.0, 2e5, 4e5]), "within ±100000 mm, got 400000 mm: are they in µm"),
        (wrong(forward_um=[0.0, 1.0]), "pnp.forward_um: expected 3 readings in µm, one for each"),
        (wrong(forward_um=[]), "pnp.forward_um: expected 3 readings"),
        (wrong(forward_um=[0.0, np.nan, 1.0]), r"pnp.forward_um: .* got nan \(at index 1\)"),
        (wrong(forward_um=[[0.0, 1.0], [2.0]]), "runs of unequal length or no numbers"),
        (wrong(forward_um=[0.0, 2e5, 4e5]), "within ±10000 µm, got 400000 µm: are they in nm"),
        (wrong(backward_um=[[1.0, 2.0]]), "pnp.backward_um: expected 3 readings in µm"),
    ],
)
def test_readings_that_cannot_be_right_are_refused(diagonals, said):
    with pytest.raises(InvalidContent, match=said):
        body_diagonal(diagonals)


def test_a_volume_that_cannot_be_right_is_refused():
    small = WorkVolume((0.0, 100.0), (0.0, 100.0), (0.0, 100.0))
    with pytest.raises(InvalidContent, match=r"along a diagonal of 173.\d+ mm, got 400 mm"):
        body_diagonal(RIGHT, volume=small)
    flat = WorkVolume((0.0, 300.0), (0.0, 0.0), (0.0, 400.0))
    with pytest.raises(InvalidContent, match="expected three sides above 0 mm"):
        body_diagonal(RIGHT, volume=flat)


def test_no_backward_runs_are_as_good_as_none():
    runs = {d: r | {"backward_um": []} for d, r in RIGHT.items()}
    assert body_diagonal(runs).reversal_um == {}
