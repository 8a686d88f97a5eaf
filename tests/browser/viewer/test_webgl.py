"""The viewers' one WebGL context: there is none, it is lost, many share it.

The last file of this folder: its tests take the context that all others draw with.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from playwright.sync_api import Page


def test_a_lost_context_comes_back_with_its_picture(page: Page) -> None:
    found = page.evaluate(
        """async () => {
          const viewer = await show("source.glb");
          const before = pixels(viewer);
          const renderer = acquireRenderer();
          const extension = renderer.gl.getContext().getExtension("WEBGL_lose_context");
          const { canvas } = renderer;
          const event = (name) => new Promise((resolve) => canvas.addEventListener(name, resolve, { once: true }));
          const lost = event("webglcontextlost");
          extension.loseContext();
          await lost;
          viewer.invalidate();
          await drawn();
          const meanwhile = difference(before, pixels(viewer));
          const told = await failure(viewer.snapshot({ width: 32, height: 32 }));
          const restored = event("webglcontextrestored");
          extension.restoreContext();
          await restored;
          viewer.surface.context.clearRect(0, 0, 999, 999);
          viewer.invalidate();
          await drawn();
          releaseRenderer();
          return { meanwhile, told, after: difference(before, pixels(viewer)) };
        }"""
    )
    assert found["meanwhile"] == 0  # the last picture stays
    assert "lost" in found["told"]["message"]
    assert found["after"] < 20


def test_a_sheet_of_many_needs_one_context_and_leaves_none_behind(page: Page) -> None:
    """The last test: it gives the page's context away."""
    found = page.evaluate(
        """async () => {
          let made = 0;
          const { getContext } = HTMLCanvasElement.prototype;
          HTMLCanvasElement.prototype.getContext = function (kind, ...rest) {
            if (kind.startsWith("webgl")) made++;
            return getContext.call(this, kind, ...rest);
          };
          const viewers = [];
          for (let i = 0; i < 17; i++) viewers.push(await show("source.glb"));
          const shown = viewers.map((viewer) => covered(pixels(viewer)));
          const bytes = await fetchBytes("/files/source.glb");
          const size = { width: 64, height: 64 };
          const nine = Array.from({ length: 9 }, () => snapshotAssets([{ buffer: bytes }], size));
          const blobs = (await Promise.all(nine)).flat();
          const during = [made, contextCount()];
          const renderer = acquireRenderer();
          releaseRenderer();
          releaseRenderer(); // the page's own
          for (const viewer of viewers) viewer.dispose();
          const left = [contextCount(), renderer.lost, stage.querySelectorAll("canvas").length];
          HTMLCanvasElement.prototype.getContext = getContext;
          const again = await failure(viewers[0].load(bytes));
          return { shown, sizes: blobs.map((blob) => blob.size), during, left, again };
        }"""
    )
    assert min(found["shown"]) > 500
    assert len(found["sizes"]) == 9
    assert min(found["sizes"]) > 500
    assert found["during"] == [0, 1]
    assert found["left"] == [0, True, 0]
    assert "disposed" in found["again"]["message"]
