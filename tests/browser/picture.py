"""A picture of a page for the README: its verdict and the robot in 3D.
    picture.py report.html picture.png"""

import pathlib
import struct
import sys
import zlib

import browser


def packed(png):
    """The same picture in fewer bytes: five bits of each colour, rows filtered by what lies above or to the left."""
    coarse = bytes((v & 0xF8) | v >> 5 for v in range(256))
    width, height, step, rows = browser.pixels(png)
    before = bytearray(3 * width)
    raw = bytearray()
    for row in rows:
        rgb = bytearray(b"".join(row[i:i + 3] for i in range(0, width * step, step))).translate(coarse)
        filtered = [(0, rgb), (1, bytearray((rgb[i] - (rgb[i - 3] if i > 2 else 0)) & 255 for i in range(len(rgb)))),
                    (2, bytearray((a - b) & 255 for a, b in zip(rgb, before)))]
        kind, least = min(filtered, key=lambda entry: sum(min(v, 256 - v) for v in entry[1]))
        raw += bytes([kind]) + least
        before = rgb

    def chunk(name, data):
        return struct.pack(">I", len(data)) + name + data + struct.pack(">I", zlib.crc32(name + data))

    return (b"\x89PNG\r\n\x1a\n" + chunk(b"IHDR", struct.pack(">IIBBBBB", width, height, 8, 2, 0, 0, 0)) +
            chunk(b"IDAT", zlib.compress(bytes(raw), 9)) + chunk(b"IEND", b""))


page, output = sys.argv[1:]
driver = browser.driver()
try:
    browser.set_size(driver, 850, 900)
    browser.open_page(driver, page)
    driver.execute_script("""
      for (const section of document.querySelectorAll('main > section:not(#verdict):not(#robot), #verdict > .tiles ~ *, #robot > details, #robot > .note, .chosen, footer')) section.remove();
      document.querySelector('#robot .count').textContent = '4';
      dispatchEvent(new Event('resize'));""")
    driver.execute_script("""
      document.body.style.zoom = 0.78;
      const reach = (c) => { const f = kdlcal.framesAt(kdlcal.data.robot, c.joint_values).pop(); return Math.hypot(f[3], f[7]) + 0.5 * f[11]; };
      const all = kdlcal.data.measured.configurations;
      kdlcal.select(all.indexOf(all.reduce((best, c) => (reach(c) > reach(best) ? c : best))));
      kdlcalView.nearer(1.2);""")
    pathlib.Path(output).write_bytes(packed(browser.screenshot(driver, whole=True)))
finally:
    browser.close(driver)
