"""A report as a browser would see it."""

import re
from html.parser import HTMLParser


class Page(HTMLParser):
    """What a browser would see: text and figures by section, and every address."""

    def __init__(self, text):
        super().__init__()
        self.sections, self.figures, self.addresses, self.text = [], set(), [], {}
        self.feed(text)

    def handle_starttag(self, tag, attrs):
        fields = dict(attrs)
        if tag == "section" and "id" in fields:
            self.sections.append(fields["id"])
        if tag == "svg":
            self.figures.add(self.sections[-1])
        self.addresses += [v for k, v in attrs if k in ("src", "href", "xlink:href", "srcset", "action", "data")]
        self.addresses += [a for v in fields.values() if v for a in re.findall(r"url\(([^)]*)\)", v)]

    def handle_data(self, data):
        if self.sections:
            self.text[self.sections[-1]] = self.text.get(self.sections[-1], "") + data


def check_one_file(text):
    """It loads nothing, and no clip path or marker of one figure can be taken for another's."""
    page = Page(text)
    assert page.addresses
    assert [a for a in page.addresses if not a.strip("'\"").startswith(("#", "data:image/png;base64,"))] == []
    plain = re.sub(r"base64,[^\"]*", "", text)
    assert re.findall(r"https?:|//[a-z]|@import|<script|<link|<iframe", plain) == []
    used = {a.strip("'\"")[1:] for a in page.addresses if a.startswith("#")}
    found = re.findall(r'\bid="([^"]+)"', text)
    assert used <= set(found)
    assert sorted(name for name in used if found.count(name) > 1) == []
