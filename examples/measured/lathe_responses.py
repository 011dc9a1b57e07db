"""The lathe's responses, each run held out in turn, beside black boxes on the same rows.

All learn of the same columns and rows: what every driver and the error have changed by since the
run's start. It is how an analysis judges a response; what the service then does with runs that
took no part in the analysis at all, `lathe_public` shows.
"""

from __future__ import annotations

from pathlib import Path

from app.identification.analysis.response_judged import Judged, judge
from app.identification.analysis.response_rows import response_rows
from app.identification.campaign import residuals_of
from examples.measured.black_boxes import black_boxes, left_of, print_left
from examples.measured.lathe import make_lathe
from examples.measured.lathe_runs import DISPLACEMENTS, read_runs

LITTLE = 0.75


def print_report(data: Path) -> None:
    """Print what runs held out are left with."""
    lathe = make_lathe(read_runs(data))
    residuals = residuals_of(lathe.campaign([run.date for run in lathe.runs]))
    for code in DISPLACEMENTS:
        rows = response_rows(residuals, code)
        judged = judge(rows)
        print(f"  {code}, runs held out, from their zero [µm]; the run that loses most")
        for name, left in (
            ("uncompensated", judged.uncompensated),
            ("maps", judged.before),
            ("response", judged.after),
        ):
            print_left(name, judged.uncompensated, left)
        courses = [one.course for one in rows.set_ups]
        for name, learn in black_boxes().items():
            left = [
                left_of(learn, courses[:i] + courses[i + 1 :], [one])[0]
                for i, one in enumerate(courses)
            ]
            print_left(name, judged.uncompensated, left)
        print_left("response, against maps", judged.before, judged.after)
        _print_response(judged)


def _print_response(judged: Judged) -> None:
    refused = judged.why_not
    print(f"    {'not offered: ' + refused if refused else 'offered'}, chance {judged.chance:.1g}")
    weights = judged.fitted.response.weights
    labels = [one.label for one in judged.rows.set_ups]
    if weights is not None:
        odd = [f"{la} {w:.2f}" for la, w in zip(labels, weights, strict=True) if w < LITTLE]
        print(f"    runs that count less: {', '.join(odd) or 'none'}")
    for one in judged.causes:
        print(f"    {one.sentence}")
