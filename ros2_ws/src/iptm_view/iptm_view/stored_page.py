"""The page of a whole run as one file, which plays without a server."""

from __future__ import annotations

import re
from base64 import b64encode
from pathlib import Path

from iptm_core.errors import ViewError
from iptm_view.page_feed import Cursor, PageFeed, json_text
from iptm_view.page_server import PAGE

_MAIN = "view.js"
_IMPORT = re.compile(r'from "\./(\w+)\.js"')


def stored_page(feed: PageFeed) -> str:
    """Return the page with everything that a feed holds, and all the code and styles inside.

    Browsers load no modules from files beside a page, so an import map gives every module as data.
    """
    modules = {
        file.stem: _data("text/javascript", _named(file))
        for file in PAGE.glob("*.js")
        if file.name != _MAIN
    }
    _, events = feed.changes(Cursor(), timeout_s=0.0)
    held = ",".join(f'["{event.kind}",{event.text}]' for event in events).replace("</", r"<\/")
    style = (PAGE / "view.css").read_text(encoding="utf-8")
    icon = _data("image/svg+xml", (PAGE / "icon.svg").read_text(encoding="utf-8"))
    parts = {
        '<link rel="icon" href="icon.svg">': f'<link rel="icon" href="{icon}">',
        '<link rel="stylesheet" href="view.css">': f"<style>{style}</style>",
        f'<script type="module" src="{_MAIN}"></script>': (
            f'<script type="importmap">{json_text({"imports": modules})}</script>\n'
            f'<script type="application/json" id="stored">[{held}]</script>\n'
            f'<script type="module">{_named(PAGE / _MAIN)}</script>'
        ),
    }
    text = (PAGE / "index.html").read_text(encoding="utf-8")
    for linked, inside in parts.items():
        text = text.replace(linked, inside)
    return text


def save_page(feed: PageFeed, path: Path) -> None:
    """Write the page of a feed to a new file.

    Raises:
        ViewError: the file exists, or cannot be written.
    """
    try:
        with path.open("x", encoding="utf-8") as file:
            file.write(stored_page(feed))
    except FileExistsError:
        raise ViewError(f"{path} exists already; allowed: a new file") from None
    except OSError as error:
        raise ViewError(f"{path} cannot be written: {error.strerror}") from None


def _named(file: Path) -> str:
    """Return a module that imports others by their names in the import map."""
    return _IMPORT.sub(r'from "\1"', file.read_text(encoding="utf-8"))


def _data(kind: str, text: str) -> str:
    return f"data:{kind};base64,{b64encode(text.encode()).decode()}"
