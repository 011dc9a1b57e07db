"""A tilted flat mirror [V IV C]: what of it shows, what does not matter, what is left.

Eight small angles on four diagonals. Linear algebra decides, on the twelve numbers that
twelve sorted sets of constant increments give.
"""

import numpy as np
import pytest
from scipy.linalg import null_space

from app.geometry.chain import Chain
from app.geometry.error_table import Table
from app.measurement.step_diagonal import step_diagonal
from app.measurement.step_diagonal_readings import step_diagonal_readings
from tests.measurement.step_diagonal_example import (
    ORIGIN,
    SQUARENESS,
    STEP,
    STEPS,
    TRANSLATIONS,
    WAYS,
    derive,
    errors_of,
    field_of,
    increments_by_hand,
    nodes,
    random_tables,
    table_of,
)

THREE = ["ppp", "npp", "pnp"]
R = np.linalg.norm(STEP)


def increments(tables=None, tilts=None, diagonals=tuple(WAYS)):
    """One step of each axis on each diagonal: what a constant error or tilt adds, a column."""
    read = step_diagonal_readings(
        field_of(tables or {}), ORIGIN, STEP, 1, mirror_tilts_urad=tilts, diagonals=diagonals
    )
    return np.concatenate([np.diff(rows.ravel(), prepend=0.0) for rows in read.values()])


def slope(code):
    return {code: Table(nodes(code[2]), 0.01 * nodes(code[2]))}


def mirrors(diagonals=tuple(WAYS)):
    angles = [(100.0, 0.0), (0.0, 100.0)]
    return np.array(
        [increments(tilts={d: a}, diagonals=diagonals) for d in diagonals for a in angles]
    ).T


def scales(diagonals=tuple(WAYS)):
    return np.array([increments(slope(c), diagonals=diagonals) for c in ("EXX", "EYY", "EZZ")]).T


def squareness(diagonals=tuple(WAYS)):
    return np.array([increments({c: Table((), 10.0)}, diagonals=diagonals) for c in SQUARENESS]).T


def turns():
    """The whole machine turned: opposite slopes of two straightness errors."""
    found = []
    for a, b in ("XY", "YZ", "ZX"):
        minus = Table(nodes(a), -0.01 * nodes(a))
        found.append(increments(slope(f"E{a}{b}") | {f"E{b}{a}": minus}))
    return np.array(found).T


def rank(*blocks):
    return np.linalg.matrix_rank(np.hstack(blocks), tol=1e-9)


def test_four_diagonals_leave_all_squareness_and_one_scale():
    assert rank(mirrors()) == 8
    # All three squareness errors are seen beside any tilt …
    assert rank(mirrors(), squareness()) == 11
    # … but of three scales one sum only: the diagonals' mean scale.
    assert rank(mirrors(), scales()) == 9
    assert rank(mirrors(), squareness(), scales()) == 12
    mean_scale = scales() @ STEP**-2.0
    assert rank(mirrors(), squareness(), mean_scale[:, None]) == 12


def test_the_eight_angles_are_three_closures_three_turns_and_two_scales():
    across = np.array([-1.0, 1.0, 1.0, 1.0]) / 2
    ways = np.array(list(WAYS.values()))
    # Row u picks the closure of axis u out of the twelve increments.
    closures = np.array([(across[:, None] * ways * np.eye(3)[u]).ravel() for u in range(3)])
    assert np.linalg.matrix_rank(closures @ mirrors(), tol=1e-9) == 3
    assert rank(mirrors(), turns()) == 8
    assert rank(turns()) == 3
    # Tilts that no closure sees: turns, and two differences of scales.
    hidden = mirrors() @ null_space(closures @ mirrors(), rcond=1e-9)
    assert rank(hidden) == 5
    assert rank(hidden, turns()) == 5
    assert rank(hidden, turns(), scales()) == 6
    # The scales among them leave the diagonals' lengths alone: Σ s_u² a_u = 0.
    differences = scales() @ np.array([[1.0, 0.0], [0.0, 1.0], [0.0, 0.0]])
    differences[:, 0] -= scales()[:, 2] * STEP[0] ** 2 / STEP[2] ** 2
    differences[:, 1] -= scales()[:, 2] * STEP[1] ** 2 / STEP[2] ** 2
    assert rank(hidden, turns(), differences) == 5
    assert rank(turns(), differences) == 5
    assert rank(hidden, squareness()) == 8


def test_three_diagonals_do_not_even_leave_the_squareness():
    assert rank(mirrors(THREE)) == 6
    assert rank(mirrors(THREE), squareness(THREE)) == 9
    # Nine numbers: mean scale and three squareness errors are one too many.
    assert rank(mirrors(THREE), squareness(THREE), scales(THREE)) == 9
    assert rank(mirrors(THREE), scales(THREE)) == 7


def some_tilts(seed, size=100.0, diagonals=tuple(WAYS)):
    rng = np.random.default_rng(seed)
    return {d: tuple(rng.normal(scale=size, size=2)) for d in diagonals}


def test_tilts_change_the_scales_and_nothing_else():
    field = field_of(random_tables(31, [*TRANSLATIONS, *SQUARENESS]))
    aligned = derive(step_diagonal_readings(field, ORIGIN, STEP, STEPS))
    tilted = derive(
        step_diagonal_readings(field, ORIGIN, STEP, STEPS, mirror_tilts_urad=some_tilts(31))
    )
    before, after = errors_of(aligned), errors_of(tilted)
    added = []
    for code, values in before.items():
        change = after[code] - values
        if code in ("EXX", "EYY", "EZZ"):
            # A straight line, of a good 10 µm over the axis.
            np.testing.assert_allclose(np.diff(change, 2), 0.0, atol=1e-10)
            added.append(change[-1])
        else:
            np.testing.assert_allclose(change, 0.0, atol=1e-9)
    assert np.abs(added).max() > 5.0
    # The weighted mean of the scales stays: Σ s_u · E_u(end) is the diagonals' length.
    assert STEP @ added == pytest.approx(0.0, abs=1e-8)
    figures = tilted.result.figures
    assert figures["diagonal_scale_um_per_m"] == pytest.approx(
        aligned.result.figures["diagonal_scale_um_per_m"]
    )


def test_without_its_closures_a_tilt_would_be_in_the_squareness():
    """The slopes' plain sum, as domain and paper have it, is wrong by R/(2UV) closures of w."""
    read = step_diagonal_readings(
        field_of({}), ORIGIN, STEP, STEPS, mirror_tilts_urad=some_tilts(36)
    )
    four = derive(read)
    # The same increments, all four diagonals, by numpy's solver and without any closure.
    design = np.array(list(WAYS.values())) * STEP / R
    sorted_um = increments_by_hand(read)
    moved = [
        np.linalg.lstsq(design, [sorted_um[d, u, 0] for d in WAYS], rcond=None)[0] for u in range(3)
    ]
    closures = four.closure_um.mean(axis=1)
    for code, (u, v, w) in {"SXY": (0, 1, 2), "SYZ": (1, 2, 0), "SZX": (2, 0, 1)}.items():
        plain = (moved[u][v] / STEP[u] + moved[v][u] / STEP[v]) * 1000.0
        assert abs(plain) > 5.0
        assert plain == pytest.approx(R * closures[w] / (2 * STEP[u] * STEP[v]) * 1000.0)
        assert errors_of(four)[code][0] == pytest.approx(0.0, abs=1e-9)


@pytest.mark.slow
def test_the_closures_show_how_large_the_tilts_are():
    """Three means of closures: a rough estimate, right on the average (root mean square)."""
    rng = np.random.default_rng(32)
    seen = []
    for seed in range(200):
        read = step_diagonal_readings(
            field_of({}), ORIGIN, STEP, STEPS,
            mirror_tilts_urad=some_tilts(seed), noise_um=0.2, rng=rng,
        )  # fmt: skip
        found = derive(read)
        seen.append(found.noise.seen_tilt_urad or 0.0)
        assert found.noise.tilt_urad == seen[-1]
    # A mean square of 3 · 200 angles' shares: ±6 %.
    assert np.sqrt(np.mean(np.square(seen))) == pytest.approx(100.0, rel=0.12)


@pytest.mark.slow
def test_noise_is_not_taken_for_a_tilt():
    rng = np.random.default_rng(33)
    field = field_of({})
    mistaken = 0
    for _ in range(200):
        read = step_diagonal_readings(field, ORIGIN, STEP, STEPS, noise_um=1.0, rng=rng)
        found = derive(read)
        mistaken += found.noise.seen_tilt_urad is not None
        assert found.noise.hidden_tilt_urad > 10.0
    # One in a hundred by the level of the test.
    assert mistaken <= 7


def test_removing_the_means_keeps_tilts_out_of_the_noise():
    rng = np.random.default_rng(34)
    read = step_diagonal_readings(
        field_of({}), ORIGIN, STEP, 40,
        mirror_tilts_urad=some_tilts(34, 300.0), noise_um=0.5, rng=rng,
    )  # fmt: skip
    found = derive(read)
    assert found.noise.reading_um == pytest.approx(0.5, rel=0.2)
    assert derive(read, mirror_angle_urad=0.0).noise.reading_um > 2.0


@pytest.mark.slow
@pytest.mark.parametrize("diagonals", [tuple(WAYS), tuple(THREE)])
def test_a_stated_tilt_is_in_the_standard_errors(diagonals):
    """Many set-ups of one machine, tilts only: the spread is what was stated."""
    field = field_of({})
    drawn = []
    for seed in range(250):
        read = step_diagonal_readings(
            field, ORIGIN, STEP, 2, diagonals=diagonals,
            mirror_tilts_urad=some_tilts(seed, 50.0, diagonals),
        )  # fmt: skip
        found = derive(read, mirror_angle_urad=50.0, repeatability_um=1e-5)
        drawn.append({code: values[-1] for code, values in errors_of(found).items()})
    for code in ("EXX", "EYY", "EZZ", *SQUARENESS):
        stated = table_of(found, code).standard_errors[-1]
        spread = np.std([values[code] for values in drawn])
        if code in SQUARENESS and len(diagonals) == 4:
            assert spread < 1e-8
            assert stated < 1e-3
        else:
            # 250 draws: 4.5 %.
            assert spread == pytest.approx(stated, rel=0.15)
            assert stated > 1e-1


def test_a_tilt_of_a_hundred_microradians_spoils_a_cubes_scales_by_seventy():
    """τ/√2 on a cube."""
    read = step_diagonal_readings(field_of({}), ORIGIN, [50.0, 50.0, 50.0], 4)
    figures = step_diagonal(
        Chain.parse("XYFZ"), ORIGIN, [50.0, 50.0, 50.0], read, mirror_angle_urad=100.0
    ).result.figures
    for axis in "xyz":
        assert figures[f"mirror_scale_{axis}_um_per_m"] == pytest.approx(100.0 / np.sqrt(2.0))


def test_the_notes_say_what_was_done_about_the_mirror():
    rng = np.random.default_rng(35)
    quiet = step_diagonal_readings(field_of({}), ORIGIN, STEP, STEPS, noise_um=0.5, rng=rng)
    loud = step_diagonal_readings(
        field_of({}), ORIGIN, STEP, STEPS,
        mirror_tilts_urad=some_tilts(35, 400.0), noise_um=0.5, rng=rng,
    )  # fmt: skip

    def said(read, **options):
        return " ".join(derive(read, **options).result.notes)

    assert "none is counted, though less than" in said(quiet)
    assert "that the closures' means show are counted" in said(loud)
    assert "20 µrad are counted as stated" in said(quiet, mirror_angle_urad=20.0)
    assert "more than was stated" in said(loud, mirror_angle_urad=20.0)
    assert "tilted flat mirror" not in said(quiet, mirror_angle_urad=0.0)
