"""Pictures of the mails for docs/notifications.md.

The HTML is what Alertmanager sent to tests/e2e/notifications/test_mail_texts.py. Needs Chromium or
Chrome in PATH and nothing else. Each picture has the hash of its HTML, which a test compares.
"""

from __future__ import annotations

import hashlib
import html
import re
import shutil
import struct
import subprocess
import tempfile
import zlib
from collections.abc import Iterable
from pathlib import Path

CHECKOUT = Path(__file__).resolve().parents[1]
MAILS = CHECKOUT / "tests" / "data" / "mails"
IMAGES = CHECKOUT / "docs" / "images"
WIDTH = 390  # pixels, of a telephone
# picture -> the mail, and whether the telephone is dark
PICTURES = {
    "mail-fault.png": ("fault.html", False),
    "mail-fault-dark.png": ("fault.html", True),
    "mail-recovery.png": ("recovery.html", False),
}
BROWSERS = ("chromium", "chromium-browser", "google-chrome")
KEYWORD = b"Source"  # of the PNG's text
SIGNATURE = b"\x89PNG\r\n\x1a\n"
_OPTIONS = ("--headless", "--no-sandbox", "--disable-gpu", "--hide-scrollbars")
# A frame, because Chromium's own window may not be that narrow.
_PAGE = """<!DOCTYPE html><body style="margin:0"><iframe srcdoc="{mail}"
style="display:block;border:0;width:{width}px;height:{height}px"></iframe><script>onload = () => {{
document.body.dataset.height = document.querySelector("iframe").contentDocument.body.scrollHeight }}
</script>"""


def source(mail: str) -> bytes:
    """The hash of a mail's HTML."""
    return hashlib.sha256(mail.encode()).hexdigest().encode()


def source_of(picture: bytes) -> bytes:
    """The hash of the HTML that a picture was made of; empty if it names none."""
    place = len(SIGNATURE)
    while place < len(picture):
        size, kind = struct.unpack(">I4s", picture[place : place + 8])
        content = picture[place + 8 : place + 8 + size]
        if kind == b"tEXt" and content.startswith(KEYWORD + b"\0"):
            return content.removeprefix(KEYWORD + b"\0")
        place += 12 + size
    return b""


def stale() -> list[Path]:
    """The pictures that are not of the present mails."""
    found = []
    for name, (file, _dark) in PICTURES.items():
        path = IMAGES / name
        mail = (MAILS / file).read_text(encoding="utf-8")
        if not path.exists() or source_of(path.read_bytes()) != source(mail):
            found.append(path)
    return found


def make(pictures: Iterable[Path]) -> None:
    """Write pictures anew.

    Raises:
        LookupError: There is no browser.
    """
    for path in pictures:
        file, dark = PICTURES[path.name]
        mail = (MAILS / file).read_text(encoding="utf-8")
        path.write_bytes(_with_source(_render(_browser(), mail, dark=dark), source(mail)))


def _browser() -> str:
    found = next(filter(None, map(shutil.which, BROWSERS)), None)
    if found is None:
        raise LookupError(f"no browser for {IMAGES}: install one of {', '.join(BROWSERS)}")
    return found


def _render(browser: str, mail: str, *, dark: bool) -> bytes:
    """The PNG of a mail in the width of a telephone, as high as it is."""
    with tempfile.TemporaryDirectory() as folder:
        page, png = Path(folder) / "page.html", Path(folder) / "mail.png"
        scheme = f"--blink-settings=preferredColorScheme={0 if dark else 1}"
        options = [browser, *_OPTIONS, scheme, f"--user-data-dir={folder}/profile"]

        def write(height: int) -> None:
            quoted = html.escape(mail)
            page.write_text(_PAGE.format(mail=quoted, width=WIDTH, height=height), encoding="utf-8")

        write(100)
        dom = _run([*options, "--dump-dom", page.as_uri()])
        found = re.search(r'data-height="(\d+)"', dom)
        if found is None:
            raise RuntimeError(f"{browser} shows no page: {dom[:200]}")
        height = int(found[1])
        write(height)
        _run([*options, f"--window-size={WIDTH},{height}", f"--screenshot={png}", page.as_uri()])
        return png.read_bytes()


def _run(argv: list[str]) -> str:
    done = subprocess.run(  # noqa: S603 - the browser, with what this file has put together
        argv, capture_output=True, text=True, timeout=120, check=False
    )
    if done.returncode:
        raise RuntimeError(f"{argv[0]} failed: {done.stderr[-500:]}")
    return done.stdout


def _with_source(picture: bytes, of: bytes) -> bytes:
    """The picture with a text of which HTML it is, after its header."""
    if not picture.startswith(SIGNATURE):
        raise RuntimeError("the browser wrote no PNG")
    header = len(SIGNATURE) + 25
    text = b"tEXt" + KEYWORD + b"\0" + of
    chunk = struct.pack(">I", len(text) - 4) + text + struct.pack(">I", zlib.crc32(text))
    return picture[:header] + chunk + picture[header:]
