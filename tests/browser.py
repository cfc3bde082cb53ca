"""A page in a real browser, which tests use as a person would: by the pointer and the keys.

Chromium is driven over a pair of pipes, so no port is opened and no driver program is needed. The commands
and events are those of the Chrome DevTools Protocol; pointer and keys reach the page as trusted events.
"""

import base64
import json
import os
import select
import shutil
import subprocess
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import pytest

PROGRAM = next(
    (found for name in ("chromium", "chromium-browser", "google-chrome") if (found := shutil.which(name))),
    None,
)
DEADLINE_S = 30.0
_QUIET = (
    "--headless", "--no-sandbox", "--disable-gpu", "--no-first-run", "--disable-background-networking",
    "--disable-component-update", "--disable-sync", "--hide-scrollbars", "--mute-audio",
)  # fmt: skip
_BUTTONS = {"left": 1, "right": 2, "middle": 4}


class Page:
    """A page that is open in the browser.

    Parameters
    ----------
    commands, answers : int
        File descriptors of the pipes to and from the browser.
    """

    def __init__(self, commands: int, answers: int) -> None:
        self._commands, self._answers = commands, answers
        self._rest, self._number = b"", 0
        self._session: dict[str, str] = {}
        target = self.tell("Target.createTarget", url="about:blank")["targetId"]
        attached = self.tell("Target.attachToTarget", targetId=target, flatten=True)
        self._session = {"sessionId": attached["sessionId"]}
        self.errors: list[str] = []
        self.requests: list[str] = []
        self.dialogs: list[str] = []
        self.downloads: list[str] = []
        for domain in ("Page", "Runtime", "Network", "Log"):
            self.tell(f"{domain}.enable")

    def tell(self, method: str, **parameters: Any) -> dict[str, Any]:
        """Send a command and return its answer; keep what the page complains of, and accept its dialogs."""
        number = self._send(method, **parameters)
        while (answer := self._next(method)).get("id") != number:
            self._note(answer)
        assert "error" not in answer, answer
        return answer["result"]

    def _send(self, method: str, **parameters: Any) -> int:
        self._number += 1
        message = {"id": self._number, "method": method, "params": parameters, **self._session}
        os.write(self._commands, json.dumps(message).encode() + b"\0")
        return self._number

    def _next(self, method: str) -> dict[str, Any]:
        while b"\0" not in self._rest:
            ready, _, _ = select.select([self._answers], [], [], DEADLINE_S)
            assert ready, f"the browser does not answer {method}"
            part = os.read(self._answers, 2**20)
            assert part, f"the browser ended at {method}"
            self._rest += part
        message, self._rest = self._rest.split(b"\0", 1)
        return json.loads(message)

    def _note(self, event: dict[str, Any]) -> None:
        method, parameters = event.get("method"), event.get("params", {})
        if method == "Runtime.exceptionThrown":
            self.errors.append(json.dumps(parameters["exceptionDetails"])[:500])
        elif method == "Log.entryAdded" and parameters["entry"]["level"] == "error":
            self.errors.append(parameters["entry"]["text"])
        elif method == "Page.javascriptDialogOpening":
            self.dialogs.append(parameters["type"])
            self._send("Page.handleJavaScriptDialog", accept=True)
        elif method == "Browser.downloadProgress":
            self.downloads.append(parameters["state"])
        elif method == "Network.requestWillBeSent":
            self.requests.append(parameters["request"]["url"][:100])

    def open(self, path: Path, width: int = 1200, height: int = 800) -> None:
        """Open a file in a window of this size, and wait until the page says that it is ready."""
        self.tell(
            "Emulation.setDeviceMetricsOverride",
            width=width,
            height=height,
            deviceScaleFactor=1,
            mobile=False,
        )
        self.tell("Page.navigate", url=path.as_uri())
        self.ask(
            "new Promise((done) => { const look = () => document.body?.dataset.ready ? done(1)"
            " : requestAnimationFrame(look); look(); })"
        )

    def ask(self, script: str) -> Any:
        """Return the value of an expression in the page; a promise is awaited."""
        found = self.tell("Runtime.evaluate", expression=script, awaitPromise=True, returnByValue=True)
        assert "exceptionDetails" not in found, found
        return found["result"].get("value")

    def place_of(self, selector: str) -> tuple[float, float]:
        """Return the middle of an element, in px of the window."""
        script = "(() => { const box = document.querySelector(%s).getBoundingClientRect();"
        x, y = self.ask(
            script % json.dumps(selector) + " return [box.x + box.width / 2, box.y + box.height / 2]; })()"
        )
        return x, y

    def pointer(self, kind: str, at: tuple[float, float], button: str = "none", **more: Any) -> None:
        """Send one event of the mouse: mousePressed, mouseReleased, mouseMoved or mouseWheel."""
        self.tell("Input.dispatchMouseEvent", type=kind, x=at[0], y=at[1], button=button, **more)

    def click(self, at: str | tuple[float, float], button: str = "left") -> None:
        """Click an element or a place of the window."""
        self.drag(self.place_of(at) if isinstance(at, str) else at, button=button)

    def drag(self, start: tuple[float, float], *ways: tuple[float, float], button: str = "left") -> None:
        """Press the button, move through all places, and release it at the last one."""
        held = {"buttons": _BUTTONS[button]}
        self.pointer("mouseMoved", start)
        self.pointer("mousePressed", start, button, clickCount=1, **held)
        for way in ways:
            self.pointer("mouseMoved", way, button, **held)
        self.pointer("mouseReleased", ways[-1] if ways else start, button, clickCount=1)

    def press(self, key: str, modifiers: int = 0) -> None:
        """Press and release a key; 2 as a modifier is Control."""
        code = {"Enter": 13, "Escape": 27, "Delete": 46, "Backspace": 8}.get(key, ord(key.upper()[0]))
        for kind in ("rawKeyDown", "keyUp"):
            self.tell(
                "Input.dispatchKeyEvent", type=kind, key=key, windowsVirtualKeyCode=code, modifiers=modifiers
            )

    def type(self, selector: str, text: str) -> None:
        """Replace the text of a field, and leave the field."""
        field = f"document.querySelector({json.dumps(selector)})"
        self.ask(f"{field}.focus(), {field}.select()")
        self.tell("Input.insertText", text=text)
        self.ask("document.activeElement.blur()")

    def download(self, selector: str, folder: Path) -> Path:
        """Click an element and return the file that the browser saves, once it is whole.

        The browser makes an empty file of the final name first, so that the name alone says nothing.
        """
        before = set(folder.iterdir())
        self.tell(
            "Browser.setDownloadBehavior", behavior="allow", downloadPath=str(folder), eventsEnabled=True
        )
        self.downloads.clear()
        self.click(selector)
        while "completed" not in self.downloads:
            assert "canceled" not in self.downloads, f"the browser saved no file for {selector}"
            self._note(self._next(f"a click on {selector} by a file"))
        (saved,) = set(folder.iterdir()) - before
        return saved

    def picture(self, path: Path) -> None:
        """Save what the window shows as PNG."""
        path.write_bytes(base64.b64decode(self.tell("Page.captureScreenshot", format="png")["data"]))


@contextmanager
def browser(profile: Path) -> Iterator[Page]:
    """Start the browser with an empty profile and give an empty page; skip the test without a browser."""
    if PROGRAM is None:
        pytest.skip("needs chromium: pages are tried in a real browser")
    theirs_in, ours_out = os.pipe()
    ours_in, theirs_out = os.pipe()
    # Chromium reads commands from descriptor 3 and writes answers to descriptor 4.
    script = f'exec "$0" "$@" 3<&{theirs_in} 4>&{theirs_out}'
    command = [PROGRAM, *_QUIET, "--remote-debugging-pipe", f"--user-data-dir={profile}"]
    process = subprocess.Popen(
        ["bash", "-c", script, *command],
        pass_fds=(theirs_in, theirs_out),
        stdout=subprocess.DEVNULL,
        stderr=subprocess.DEVNULL,
    )
    os.close(theirs_in)
    os.close(theirs_out)
    try:
        yield Page(ours_out, ours_in)
    finally:
        process.terminate()
        process.wait(30.0)
        os.close(ours_in)
        os.close(ours_out)
