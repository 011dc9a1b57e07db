"""The lathe's responses, each run held out in turn, beside black boxes on the same rows.

All learn of the same columns and rows: what every driver and the error have changed by since the
run's start. Then every third run in time is unseen, three times over, so that each is once.
"""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Final

import numpy as np

from app.arrays import FloatArray
from app.effects.observations import ObservationRows
from app.identification.analysis.response_judged import Judged, judge
from app.identification.analysis.response_rows import response_rows
from app.identification.analysis.responses import find_responses
from app.identification.campaign import residuals_of
from app.search.figures import rms
from examples.measured.black_boxes import black_boxes, left_of, print_left
from examples.measured.lathe import Lathe, make_lathe
from examples.measured.lathe_runs import DISPLACEMENTS, read_runs

UNSEEN_EACH: Final = 3


def print_report(data: Path, folds: int) -> None:
    """Print what runs held out are left with; every run is held out, whatever `folds` says."""
    lathe = make_lathe(read_runs(data))
    residuals = residuals_of(lathe.campaign([run.date for run in lathe.runs]))
    for code in DISPLACEMENTS:
        rows = response_rows(residuals, code)
        judged = judge(rows)
        print(f"  {code}, runs held out, from their zero [µm]; the run that gains least")
        print_left("maps", judged.before, judged.before)
        print_left("response", judged.before, judged.after)
        print("    the same, against runs without any correction")
        print_left("maps", judged.uncompensated, judged.before)
        print_left("response", judged.uncompensated, judged.after)
        courses = [one.course for one in rows.set_ups]
        for name, learn in black_boxes().items():
            left = [
                left_of(learn, courses[:i] + courses[i + 1 :], [one])[0]
                for i, one in enumerate(courses)
            ]
            print_left(name, judged.before, left)
        _print_response(judged)
    _print_unseen(lathe)


def _print_unseen(lathe: Lathe) -> None:
    """Print what responses of the others leave of every third run, as a live table has them."""
    dates = [run.date for run in lathe.runs]
    for begin in range(UNSEEN_EACH):
        unseen = dates[begin::UNSEEN_EACH]
        campaign = lathe.campaign(unseen)
        taught = find_responses(lathe.campaign([d for d in dates if d not in unseen]))
        effects = [one.effect for one in taught.offered]
        maps = residuals_of(campaign)
        left = residuals_of(replace(campaign, effects=effects))
        for code in DISPLACEMENTS:
            print(
                f"  {code}, {len(dates) - len(unseen)} runs teach, unseen from {unseen[0]} on [µm]"
            )
            measured, before, after = (
                _by_run(maps.rows, values, code)
                for values in (maps.rows.measured, maps.values, left.values)
            )
            print_left("uncompensated", measured, measured)
            print_left("maps", measured, before)
            print_left("response", measured, after)
            for date, *each in zip(unseen, measured, before, after, strict=True):
                print(f"      {date}: {', '.join(f'{rms(one):.1f}' for one in each)}")


def _by_run(rows: ObservationRows, values: FloatArray, code: str) -> list[FloatArray]:
    """Part values by run, each from its first observation, which is left out."""
    own = rows.of_channel(code)
    parts = [own[rows.verification[own] == which] for which in range(len(rows.verifications))]
    ordered = [part[np.argsort(rows.times_s[part])] for part in parts]
    return [(values[part] - values[part[0]])[1:] for part in ordered]


def _print_response(judged: Judged) -> None:
    refused = judged.why_not
    print(f"    {'not offered: ' + refused if refused else 'offered'}, chance {judged.chance:.1g}")
    weights = judged.average.weights
    labels = [one.label for one in judged.rows.set_ups]
    odd = [f"{label} {w:.2f}" for label, w in zip(labels, weights, strict=True) if w < 0.75]
    print(f"    runs that count less: {', '.join(odd) or 'none'}")
