"""Walk ten ways through the page as a person does: ``python -m bench.journeys [NAME ...]``.

Starts a service in a temporary folder, and Chromium on it. For each way: clicks (a choice, a field that is filled and a
command count as one, a file that is chosen as two), and seconds from the first of them until what was wanted is there.
What is there before the way begins is not counted. WebGL runs by software, so seconds are those of a slow machine.
"""

from __future__ import annotations

import argparse
import re
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any

from bench.jobs import ROOT
from bench.live import READY_S, service
from meshdeform.client import Client
from meshdeform.reading.banks import bank_of
from meshdeform.runs.kept_readings import samples_in
from meshdeform.settings import Settings

if TYPE_CHECKING:
    from playwright.sync_api import Browser, Locator, Page

NOUN, FILES = "mushroom", 20
_EXAMPLES = ROOT / "service/web/examples"


class Person:
    """Somebody at the page: counts what they do, and how long it took until they had what they wanted."""

    def __init__(self, page: Page, folder: Path, url: str) -> None:
        self.page, self.folder, self.url = page, folder, url
        self.clicks, self.seconds, self._began = 0, 0.0, time.perf_counter()

    def begin(self) -> None:
        """Count from now on."""
        self.clicks, self._began = 0, time.perf_counter()

    def there(self) -> None:
        """Stop the clock: what was wanted is there."""
        self.seconds = time.perf_counter() - self._began

    def click(self, place: Locator) -> None:
        """Click something."""
        place.click()
        self.clicks += 1

    def write(self, place: Locator, text: str) -> None:
        """Fill a field."""
        place.fill(text)
        self.clicks += 1

    def choose(self, place: Locator, number: int) -> None:
        """Choose an option by its number."""
        place.select_option(index=number)
        self.clicks += 1

    def give(self, button: str, files: list[Path]) -> None:
        """Open the browser's dialog for files, and choose some."""
        with self.page.expect_file_chooser() as chooser:
            self.page.get_by_role("button", name=button).click()
        chooser.value.set_files(files)
        self.clicks += 2

    def tag(self, text: str) -> None:
        """Wait until the view says what it shows."""
        self.page.locator(".asset-panel .viewer-tag", has_text=re.compile(f"^{text}$")).first.wait_for()

    def open(self) -> None:
        """Open the page, with its sample read."""
        self.page.goto(self.url)
        self.page.locator(".parts[aria-busy='false']").wait_for(state="attached")

    def shaped(self) -> None:
        """Open the page, and let the sample become something with other designs."""
        self.open()
        self.page.locator("#prompt").fill(f"a {NOUN}")
        self.tag("Preview")
        self.page.locator(".live-member:nth-child(6) img[src]").wait_for(state="attached")

    def shaped_twice(self) -> Locator:
        """As `shaped`, with a second design; return the shapes so far."""
        self.shaped()
        self.page.locator(".live-member").nth(2).click()
        shapes = self.page.locator(".shape")
        shapes.nth(1).wait_for()
        return shapes


def first_result(person: Person) -> None:
    """Words on the sample, until the shape is in the view."""
    person.open()
    person.begin()
    person.write(person.page.locator("#prompt"), f"a {NOUN}")
    person.tag("Preview")


def longer_legs(person: Person) -> None:
    """The sample, its legs, longer."""
    person.open()
    person.begin()
    person.click(
        person.page.get_by_role("group", name="Parts").get_by_role("button", name=re.compile("(^| )legs$")).first
    )
    person.click(person.page.get_by_role("button", name="longer", exact=True))
    person.tag("Preview")


def another_member(person: Person) -> None:
    """Another design of the six."""
    person.shaped()
    person.begin()
    with person.page.expect_response(lambda answer: "as=glb" in answer.url and answer.status == 200) as file:
        person.click(person.page.locator(".live-member").nth(2))
    file.value.finished()
    person.page.locator(".shape").nth(1).wait_for()


def compare_two(person: Person) -> None:
    """Two designs, side by side."""
    person.shaped_twice()
    person.begin()
    person.click(person.page.get_by_text("Side by side"))
    person.choose(person.page.get_by_label("Compare with"), 1)
    person.page.locator(".before .viewer-tag", has_text=f"Before: a {NOUN}").wait_for()


def undo(person: Person) -> None:
    """Back to the first design."""
    shapes = person.shaped_twice()
    person.begin()
    person.click(shapes.first)
    person.page.locator(".shape[aria-pressed='true']:first-child").wait_for()


def clip_played(person: Person) -> None:
    """A file of one's own with a clip, which plays."""
    person.open()
    person.begin()
    person.give("Choose a file", [_EXAMPLES / "walker.glb"])
    player = person.page.get_by_role("group", name="Animation")
    person.choose(player.get_by_label("Clip", exact=True), 1)
    if player.get_by_role("button", name="Play").is_visible():
        person.click(player.get_by_role("button", name="Play"))
    player.get_by_role("button", name="Pause").wait_for()


def download(person: Person) -> None:
    """The shape in the view as a file."""
    person.shaped()
    person.begin()
    with person.page.expect_download() as file:
        person.click(person.page.get_by_role("button", name="Download"))
    if not file.value.path().read_bytes().startswith(b"glTF"):
        raise SystemExit("what was downloaded is no GLB")


def twenty_files(person: Person) -> None:
    """Twenty files, one sentence, a ZIP."""
    sources = [_EXAMPLES / name for name in ("animal.glb", "car.glb", "vase.glb", "teapot.glb", "sphere.glb")]
    files = []
    for number in range(FILES):
        files.append(person.folder / f"file-{number}.glb")
        files[-1].write_bytes(sources[number % len(sources)].read_bytes())
    person.open()
    person.begin()
    person.click(person.page.get_by_role("link", name="Many files"))
    person.give("Choose files", files)
    person.write(person.page.get_by_label("What all should become"), "20 % taller")
    person.page.locator("#many-tally", has_text=f"{FILES} ready to keep").wait_for()
    with person.page.expect_download():
        person.click(person.page.get_by_role("button", name="Download ZIP"))


def api_call(person: Person) -> None:
    """The first program of the reference, copied and run."""
    person.page.context.grant_permissions(["clipboard-read", "clipboard-write"])
    (person.folder / "sphere.glb").write_bytes((_EXAMPLES / "sphere.glb").read_bytes())
    person.open()
    person.begin()
    person.click(person.page.get_by_role("navigation").get_by_role("link", name="API"))
    person.click(person.page.locator(".snippet").first.get_by_role("button", name="Copy"))
    program = person.page.evaluate("navigator.clipboard.readText()")
    subprocess.run(["bash", "-euc", program], cwd=person.folder, check=True, stdout=subprocess.DEVNULL)
    person.clicks += 1
    if not any(file.stat().st_size for file in person.folder.glob("sphere-*.glb")):
        raise SystemExit(f"the program made no result: {program}")


def key_and_usage(person: Person) -> None:
    """A key made in the shell, and on the page what it has used."""
    data = person.folder / "keyed"
    made = [sys.executable, "-m", "meshdeform", "keys", "create", "--owner", "me", "--data-dir", str(data)]
    person.begin()
    told = subprocess.run(made, check=True, capture_output=True, text=True).stdout
    person.clicks += 1
    (key,) = set(re.findall(r"mdk_\w+\S*", told.splitlines()[0] if "\n" in told else told))
    person.there()
    in_shell = person.seconds
    with service(data, MESHDEFORM_AUTH="on") as url:
        with Client(url, api_key=key) as client:  # something to read of
            client.deform(_EXAMPLES / "sphere.glb", "twice as tall")
        person.page.goto(f"{url}/#/api")
        link = person.page.get_by_role("link", name="what you have used")
        link.wait_for()
        clicks = person.clicks
        person.begin()
        person.clicks = clicks
        person.click(link)
        person.write(person.page.get_by_label("Key", exact=True), key)
        person.click(person.page.get_by_role("button", name="Use key"))
        person.page.get_by_role("table").wait_for()
        person.there()
    person.seconds += in_shell


JOURNEYS: dict[str, Callable[[Person], None]] = {
    "first result": first_result,
    "longer legs": longer_legs,
    "another member": another_member,
    "compare two": compare_two,
    "undo": undo,
    "clip played": clip_played,
    "download": download,
    "twenty files at once": twenty_files,
    "API call copied and run": api_call,
    "key made and usage read": key_and_usage,
}


@contextmanager
def browsing() -> Iterator[Browser]:
    """Run Chromium, as the tests of the page do."""
    from playwright.sync_api import sync_playwright

    from tests.browser.conftest import CHROMIUM_ARGUMENTS, chromium_path

    with sync_playwright() as playwright:
        browser = playwright.chromium.launch(executable_path=chromium_path(), args=CHROMIUM_ARGUMENTS)
        yield browser
        browser.close()


def walk(browser: Browser, url: str, journey: Callable[[Person], None]) -> tuple[int, float]:
    """Return the clicks and the seconds of a journey, in a profile of its own."""
    from tests.browser.conftest import FEW_SAMPLES

    options: dict[str, Any] = {"viewport": {"width": 1280, "height": 800}, "accept_downloads": True}
    with tempfile.TemporaryDirectory() as folder:
        context = browser.new_context(**options)
        context.set_default_timeout(1000 * READY_S)
        context.add_init_script(FEW_SAMPLES)
        person = Person(context.new_page(), Path(folder), url)
        journey(person)
        if not person.seconds:
            person.there()
        context.close()
    return person.clicks, person.seconds


def main() -> None:
    """Run the command line."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("names", nargs="*", choices=[[], *JOURNEYS], help="journeys (default: all)")
    wanted = parser.parse_args().names or list(JOURNEYS)
    bank_of(NOUN, samples_in(Settings().cache_folder), ())  # once a machine, whoever asks first
    failed = False
    with tempfile.TemporaryDirectory() as folder, service(Path(folder) / "data") as url, browsing() as browser:
        for name in wanted:
            try:
                clicks, seconds = walk(browser, url, JOURNEYS[name])
                print(f"{name:26} {clicks:3} clicks  {seconds:7.1f} s", flush=True)
            except Exception as error:  # the others are walked all the same
                failed = True
                print(f"{name:26} not walked: {str(error).splitlines()[0]}", flush=True)
    if failed:
        raise SystemExit(1)


if __name__ == "__main__":
    main()
