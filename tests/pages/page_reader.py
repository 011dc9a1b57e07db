"""Reads pages that report as a browser would."""

import json
from html.parser import HTMLParser

VOID = {"meta"}


class Reader(HTMLParser):
    """Reads a page: its elements, whether they close, and the text that a person sees."""

    def __init__(self, written):
        super().__init__(convert_charrefs=True)
        self.elements, self.open, self.text, self.figures = [], [], "", {}
        self.feed(written)
        self.close()

    def handle_starttag(self, tag, attrs):
        self.elements.append((tag, dict(attrs)))
        if tag not in VOID:
            self.open.append((tag, dict(attrs)))

    def handle_startendtag(self, tag, attrs):
        self.elements.append((tag, dict(attrs)))

    def handle_endtag(self, tag):
        assert self.open, f"</{tag}> closes nothing"
        assert self.open.pop()[0] == tag

    def handle_data(self, data):
        tag, attrs = self.open[-1] if self.open else ("", {})
        if attrs.get("id") == "figures":
            self.figures = json.loads(data)
        elif tag not in ("script", "style"):
            self.text += " " + data

    @property
    def told(self):
        return " ".join(self.text.split())

    def attributes(self, name):
        return [attrs[name] for _, attrs in self.elements if name in attrs]
