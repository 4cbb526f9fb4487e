"""Headless Chromium for the tests of the pages, and what is asked of every page."""

import base64
import io
import json
import pathlib
import shutil
import tempfile
import time


class Skipped(Exception):
    """There is no browser here."""


def driver(width=1200, height=900, dark=False):
    """A browser with an empty profile that fetches nothing by itself."""
    try:
        from selenium import webdriver
        from selenium.webdriver.chrome.options import Options
        from selenium.webdriver.chrome.service import Service
    except ImportError as error:
        raise Skipped("python3-selenium is not installed") from error
    browser, chromedriver = shutil.which("chromium"), shutil.which("chromedriver")
    if browser is None or chromedriver is None:
        raise Skipped("chromium and chromium-driver are not installed")
    profile = tempfile.mkdtemp(prefix="kdlcal_browser_")
    options = Options()
    options.binary_location = browser
    for argument in ["--headless", "--no-sandbox", "--disable-gpu", "--disable-quic", "--no-first-run",
                     "--disable-background-networking", "--disable-component-update", "--disable-sync",
                     "--hide-scrollbars", f"--window-size={width},{height}",
                     "--user-data-dir=" + profile]:
        options.add_argument(argument)
    options.set_capability("goog:loggingPrefs", {"browser": "ALL", "performance": "ALL"})
    found = webdriver.Chrome(service=Service(chromedriver), options=options)
    found.profile = profile
    found.set_script_timeout(60)
    found.set_page_load_timeout(60)
    set_colours(found, dark)
    return found


def close(browser):
    browser.quit()
    shutil.rmtree(browser.profile, ignore_errors=True)


def set_colours(browser, dark):
    browser.execute_cdp_cmd("Emulation.setEmulatedMedia",
                            {"features": [{"name": "prefers-color-scheme", "value": "dark" if dark else "light"}]})


def set_size(browser, width, height):
    """Of the page itself; a window has a least width."""
    browser.execute_cdp_cmd("Emulation.setDeviceMetricsOverride",
                            {"width": width, "height": height, "deviceScaleFactor": 1, "mobile": width < 600})


def open_page(browser, path):
    browser.get_log("performance")
    browser.get_log("browser")
    browser.get(pathlib.Path(path).resolve().as_uri())
    time.sleep(0.3)


def requests(browser):
    """Addresses that the page asked for, itself left out."""
    urls = []
    for entry in browser.get_log("performance"):
        message = json.loads(entry["message"])["message"]
        if message["method"] == "Network.requestWillBeSent":
            urls.append(message["params"]["request"]["url"])
    return [url for url in urls if url != browser.current_url.split("#")[0]]


def complaints(browser):
    return [entry["message"] for entry in browser.get_log("browser") if entry["level"] in ("SEVERE", "WARNING")]


def screenshot(browser, whole=False):
    """PNG of what is seen, or of the whole page."""
    parameters = {"format": "png"}
    if whole:
        size = browser.execute_cdp_cmd("Page.getLayoutMetrics", {})["cssContentSize"]
        parameters.update({"captureBeyondViewport": True,
                           "clip": {"x": 0, "y": 0, "width": size["width"], "height": size["height"], "scale": 1}})
    return base64.b64decode(browser.execute_cdp_cmd("Page.captureScreenshot", parameters)["data"])


def pdf(browser):
    parameters = {"printBackground": True, "preferCSSPageSize": True, "paperWidth": 8.27, "paperHeight": 11.69}
    return base64.b64decode(browser.execute_cdp_cmd("Page.printToPDF", parameters)["data"])


def pixels(png):
    """Width, height and RGB bytes of a PNG as Chromium writes it: 8 bits, RGB or RGBA, not interlaced."""
    import struct
    import zlib
    stream = io.BytesIO(png)
    assert stream.read(8) == b"\x89PNG\r\n\x1a\n"
    data = b""
    while True:
        length, kind = struct.unpack(">I4s", stream.read(8))
        chunk = stream.read(length)
        stream.read(4)
        if kind == b"IHDR":
            width, height, depth, colour = struct.unpack(">IIBB", chunk[:10])
        elif kind == b"IDAT":
            data += chunk
        elif kind == b"IEND":
            break
    assert depth == 8 and colour in (2, 6)
    step = 3 if colour == 2 else 4
    raw = zlib.decompress(data)
    stride = width * step
    rows, before = [], bytearray(stride)
    for y in range(height):
        start = y * (stride + 1)
        kind, row = raw[start], bytearray(raw[start + 1:start + 1 + stride])
        for i in range(stride):
            left = row[i - step] if i >= step else 0
            up = before[i]
            corner = before[i - step] if i >= step else 0
            if kind == 1:
                row[i] = (row[i] + left) & 255
            elif kind == 2:
                row[i] = (row[i] + up) & 255
            elif kind == 3:
                row[i] = (row[i] + (left + up) // 2) & 255
            elif kind == 4:
                p = left + up - corner
                near = min((abs(p - left), 0, left), (abs(p - up), 1, up), (abs(p - corner), 2, corner))[2]
                row[i] = (row[i] + near) & 255
        rows.append(row)
        before = row
    return width, height, step, rows


def colours(png):
    """How many different colours every seventh pixel of every fifth row has."""
    width, height, step, rows = pixels(png)
    found = set()
    for row in rows[::5]:
        for i in range(0, width * step, 7 * step):
            found.add(bytes(row[i:i + 3]))
    return len(found)


def brightness(png):
    """Mean of the pixels, 0 to 255."""
    width, height, step, rows = pixels(png)
    total = count = 0
    for row in rows[::5]:
        for i in range(0, width * step, 7 * step):
            total += sum(row[i:i + 3])
            count += 3
    return total / count
