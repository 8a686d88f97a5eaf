"""One page with viewers for the tests of a file, and the site that serves it."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from functools import partial
from typing import TYPE_CHECKING

import pytest

from tests.browser.conftest import FEW_SAMPLES, Kept, Watch
from tests.browser.steps import DEADLINE_MS
from tests.browser.viewer.assets import bent
from tests.browser.viewer.site import ViewerSite

if TYPE_CHECKING:
    from playwright.sync_api import Browser, Page


@pytest.fixture
def site(kept: Kept) -> ViewerSite:
    """The site of all these tests. A file stays until another one has its name."""
    return kept.get("site", _served)


@contextmanager
def _served() -> Iterator[ViewerSite]:
    site = ViewerSite()
    site.files["source.glb"], site.files["bent.glb"] = bent()
    yield site


@pytest.fixture
def shared(kept: Kept, browser: Browser, site: ViewerSite) -> tuple[Page, Watch]:
    """One page for all tests: the first picture compiles the shaders, which takes software seconds."""
    page, watch = kept.get("page", partial(_opened, browser, site))
    # Kept from test to test: without a viewer the context would be freed, and the next test start anew.
    page.evaluate("() => { if (!contextCount()) acquireRenderer(); }")
    return page, watch


@contextmanager
def _opened(browser: Browser, site: ViewerSite) -> Iterator[tuple[Page, Watch]]:
    context = browser.new_context(base_url=site.url, viewport={"width": 1000, "height": 760})
    context.set_default_timeout(DEADLINE_MS)
    watch = Watch(site.url)
    watch.attach(context)
    context.add_init_script(FEW_SAMPLES)
    context.route("**/*", site.answer)
    page = context.new_page()
    page.goto("/")
    page.wait_for_function("window.ready")
    yield page, watch
    context.close()


@pytest.fixture
def page(shared: tuple[Page, Watch]) -> Iterator[Page]:
    """The page without viewers; fails the test for what the console, the policy or another host has to say."""
    page, watch = shared
    yield page
    page.evaluate("closeAll()")
    faults = watch.faults(page.context)
    watch._faults.clear()
    page.evaluate("window.__violations = []")
    assert not faults, "\n".join(faults)
