"""A page that is open in a real headless Chromium."""

from tests.optional import optional_program

#: Opaque pixels of a canvas and their mean colour.
PIXELS = """canvas => {
  const { data } = canvas.getContext('2d').getImageData(0, 0, canvas.width, canvas.height);
  let [count, sum] = [0, [0, 0, 0]];
  for (let at = 0; at < data.length; at += 4) if (data[at + 3] > 128) {
    count++;
    [0, 1, 2].forEach(c => sum[c] += data[at + c]);
  }
  return { share: count / (data.length / 4), mean: sum.map(value => value / count) };
}"""


def launched(driver, *flags):
    """Start a browser; the test skips where none is installed."""
    names = ("chromium", "chromium-browser", "google-chrome")
    chromium = optional_program(*names, install="apt-get install chromium")
    return driver.chromium.launch(executable_path=chromium, args=["--no-sandbox", *flags])


class Page:
    """A page that is open, with everything that went wrong since; leaving it fails if anything did."""

    def __init__(self, browser, path, **context):
        context = {
            "offline": True,
            "accept_downloads": True,
            "viewport": {"width": 900, "height": 700},
            "device_scale_factor": 0.5,  # without a GPU, drawing takes as long as there are pixels
        } | context
        self.context = browser.new_context(**context)
        self.page = self.context.new_page()
        self.page.set_default_timeout(300_000)
        self.problems = []
        self.requests = []
        self.page.on("console", self.note)
        self.page.on("pageerror", lambda error: self.problems.append(str(error)))
        self.page.on("request", lambda request: self.requests.append(request.url))
        self.page.goto(path.as_uri())
        self.ready()

    def __enter__(self):
        return self

    def __exit__(self, kind, *_):
        self.context.close()
        assert kind is not None or self.problems == []

    def ready(self):
        self.page.wait_for_selector("html[data-ready]", state="attached")

    def reload(self):
        self.page.reload()
        self.ready()

    def note(self, message):
        """Keep errors, and what three.js warns of: a colour that it cannot read is drawn white."""
        if message.type == "error" or "THREE." in message.text:
            self.problems.append(message.text)

    def canvas(self, selector, at=0):
        canvas = self.page.locator(selector).nth(at)
        canvas.scroll_into_view_if_needed()
        canvas.and_(self.page.locator("[data-drawn]")).wait_for()
        return canvas

    def pixels(self, selector, at=0):
        return self.canvas(selector, at).evaluate(PIXELS)

    def image(self, selector, at=0):
        return self.canvas(selector, at).evaluate("canvas => canvas.toDataURL()")

    def wait_until_changed(self, selector, before, at=0):
        self.page.wait_for_function(
            "([selector, at, before]) => document.querySelectorAll(selector)[at].toDataURL() !== before",
            arg=[selector, at, before],
        )
