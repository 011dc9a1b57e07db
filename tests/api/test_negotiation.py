"""Which form of an answer a client gets."""

import pytest

from app.api.negotiation import chosen_form

JSON, HTML, NPY = "application/json", "text/html", "application/x-npy"


@pytest.mark.parametrize(
    ("accept", "form"),
    [
        ("", JSON),
        ("*/*", JSON),
        (HTML, HTML),
        ("TEXT/HTML", HTML),
        ("text/*", HTML),
        ("text/*;q=0.5, application/*;q=0.4", HTML),
        ("application/json;q=0.2, */*;q=0.1, application/x-npy", NPY),
        ("text/html;q=0, */*", JSON),
        ("image/png", JSON),
        ("text/html;q=nonsense", JSON),
        ("text/html,application/xhtml+xml,application/xml;q=0.9,*/*;q=0.8", HTML),
    ],
)
def test_the_form_that_is_liked_best(accept, form):
    assert chosen_form(accept, [JSON, HTML, NPY]) == form
