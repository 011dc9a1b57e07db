"""Ridge, boosting and trees on the rows and columns of a response: what its figures stand beside.

Boosting and trees are those of scikit-learn (extra `benchmark`) with the usual settings. The
ridge needs numpy alone; it chooses its strength by leaving out each run that it learns from.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any, Final, TypeAlias

import numpy as np

from app.arrays import FloatArray, rms
from app.search.response import Course

Learn: TypeAlias = Callable[[Sequence[Course]], Callable[[FloatArray], FloatArray]]
"""Takes courses, and gives what predicts values from columns."""

STRENGTHS: Final = 10.0 ** np.arange(-2.0, 5.0)


def black_boxes() -> dict[str, Learn]:
    """List what can be learnt here by name."""
    found: dict[str, Learn] = {"ridge": learn_ridge}
    try:
        from sklearn.ensemble import ExtraTreesRegressor, GradientBoostingRegressor
    except ImportError:
        print("    boosting and trees need scikit-learn: the extra `benchmark`")
        return found

    def boosting() -> Any:
        return GradientBoostingRegressor(
            n_estimators=200, subsample=0.5, max_features=0.2, random_state=0
        )

    def trees() -> Any:
        return ExtraTreesRegressor(200, min_samples_leaf=3, random_state=0)

    return found | {"boosting": _learn_by(boosting), "extra trees": _learn_by(trees)}


def learn_ridge(courses: Sequence[Course]) -> Callable[[FloatArray], FloatArray]:
    """Learn one shrinkage for all columns on a common scale, rows taken as independent."""
    columns = np.concatenate([course.columns for course in courses])
    size = np.sqrt(np.mean(columns**2, axis=0))
    size[size == 0.0] = 1.0
    parts = [(course.columns / size, course.values) for course in courses]
    grams = [x.T @ x for x, _ in parts]
    rights = [x.T @ y for x, y in parts]
    gram, right = np.sum(grams, axis=0), np.sum(rights, axis=0)
    one = np.eye(len(gram))

    def left(strength: float) -> float:
        return float(
            sum(
                np.sum((y - x @ np.linalg.solve(gram - g + strength * one, right - r)) ** 2)
                for (x, y), g, r in zip(parts, grams, rights, strict=True)
            )
        )

    best = min(STRENGTHS.tolist(), key=left)
    slopes = np.linalg.solve(gram + best * one, right) / size
    return lambda asked: asked @ slopes


def left_of(learn: Learn, known: Sequence[Course], unseen: Sequence[Course]) -> list[FloatArray]:
    """Learn of some runs, and give what is left of others."""
    predict = learn(known)
    return [one.values - predict(one.columns) for one in unseen]


def print_left(name: str, before: Sequence[FloatArray], after: Sequence[FloatArray]) -> None:
    """Print root mean squares of all runs, of their courses, and of the run that loses most."""
    each = np.array([[rms(one), rms(left)] for one, left in zip(before, after, strict=True)])
    worst = int(np.argmax(each[:, 1] - each[:, 0]))
    course = rms(np.concatenate([left - left.mean() for left in after]))
    print(
        f"    {name:22s} {rms(np.concatenate(after)):5.2f}, course {course:5.2f}; "
        f"{each[worst, 0]:.1f} → {each[worst, 1]:.1f}, "
        f"{int((each[:, 1] > each[:, 0]).sum())} of {len(each)} runs worse"
    )


def _learn_by(make: Callable[[], Any]) -> Learn:
    def learn(courses: Sequence[Course]) -> Callable[[FloatArray], FloatArray]:
        made = make().fit(
            np.concatenate([course.columns for course in courses]),
            np.concatenate([course.values for course in courses]),
        )

        def predict(columns: FloatArray) -> FloatArray:
            found: FloatArray = made.predict(columns)
            return found

        return predict

    return learn
