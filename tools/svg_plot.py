"""Log-log panels as SVG text, light and printable; shared by the chart_ scripts. Python standard library only."""
import html
import math

FONT = 'font-family="Helvetica, Arial, sans-serif"'
INK, GRID, FAINT = "#222222", "#d9d9d9", "#efefef"
# Okabe and Ito's colours, told apart by nearly everybody, and dashes for grey prints.
LOOKS = [("#0072B2", "", "circle"), ("#D55E00", "6 3", "square"), ("#009E73", "2 3", "triangle"), ("#CC79A7", "8 3 2 3", "diamond"), ("#7a6000", "1 3", "cross")]


class Axis:
    """Maps values of a range of powers of ten onto pixels."""

    def __init__(self, values, pixels):
        self.low, self.high = min(values) / 1.6, max(values) * 1.4
        self.pixels = pixels

    def at(self, value):
        share = math.log(value / self.low) / math.log(self.high / self.low)
        return self.pixels[0] + share * (self.pixels[1] - self.pixels[0])

    def ticks(self):
        """(value, whether it gets a number): 1, 2, 5 over few decades, else powers of ten."""
        wide = math.log10(self.high / self.low) > 2.6
        decades = range(math.floor(math.log10(self.low)), math.ceil(math.log10(self.high)) + 1)
        for decade in decades:
            for digit in range(1, 10):
                value = digit * 10.0**decade
                if self.low <= value <= self.high:
                    yield value, digit == 1 or (not wide and digit in (2, 5))


class Panel:
    """One pair of axes and what is drawn between them."""

    def __init__(self, title, frame, xs, ys):
        left, top, width, height = frame
        self.frame = frame
        self.x, self.y = Axis(xs, (left, left + width)), Axis(ys, (top + height, top))
        self.title, self.over = title, []

    def spot(self, point):
        return self.x.at(point[0]), self.y.at(point[1])

    def line(self, points, look, width=1.6):
        colour, dashes, _ = look
        path = " ".join(f"{x:.1f},{y:.1f}" for x, y in map(self.spot, points))
        dash = f' stroke-dasharray="{dashes}"' if dashes else ""
        self.over.append(f'<polyline points="{path}" fill="none" stroke="{colour}" stroke-width="{width}"{dash}/>')

    def marks(self, points, look, size=4.0):
        self.over += [marker(look[2], self.spot(point), size, look[0]) for point in points]

    def label(self, point, text, colour=INK):
        """A word below and to the left of a point, on a white seam: under curves that fall."""
        x, y = self.spot(point)
        written = words((x - 5, y + 14), text, 11, colour, "end")
        seam = 'stroke="white" stroke-width="3" stroke-linejoin="round"'
        self.over += [written.replace("<text", f"<text {seam}", 1), written]

    def svg(self, x_label, y_label, formats):
        """The axes with numbers by `formats`, and what was drawn, clipped to them."""
        left, top, width, height = self.frame
        out = []
        for value, numbered in self.x.ticks():
            at = self.x.at(value)
            out.append(rule((at, top), (at, top + height), GRID if numbered else FAINT))
            if numbered:
                out.append(words((at, top + height + 16), formats[0](value), 11, INK, "middle"))
        for value, numbered in self.y.ticks():
            at = self.y.at(value)
            out.append(rule((left, at), (left + width, at), GRID if numbered else FAINT))
            if numbered:
                out.append(words((left - 6, at + 4), formats[1](value), 11, INK, "end"))
        out.append(f'<rect x="{left}" y="{top}" width="{width}" height="{height}" fill="none" stroke="{INK}"/>')
        out.append(headline((left + width / 2, top - 9), self.title, 14))
        out.append(words((left + width / 2, top + height + 35), x_label, 12, INK, "middle"))
        turned = words((0, 0), y_label, 12, INK, "middle")
        out.append(f'<g transform="translate({left - 48} {top + height / 2}) rotate(-90)">{turned}</g>')
        return out + self.over


def marker(shape, spot, size, colour):
    x, y = spot
    if shape == "circle":
        return f'<circle cx="{x:.1f}" cy="{y:.1f}" r="{size}" fill="{colour}" stroke="white" stroke-width="0.8"/>'
    outline = {
        "square": [(-1, -1), (1, -1), (1, 1), (-1, 1)],
        "triangle": [(0, -1.2), (1.1, 0.9), (-1.1, 0.9)],
        "diamond": [(0, -1.3), (1.3, 0), (0, 1.3), (-1.3, 0)],
        "cross": [(-1.2, -0.5), (-0.5, -1.2), (0, -0.5), (0.5, -1.2), (1.2, -0.5), (0.5, 0), (1.2, 0.5), (0.5, 1.2), (0, 0.5), (-0.5, 1.2), (-1.2, 0.5), (-0.5, 0)],
    }[shape]
    path = " ".join(f"{x + 0.9 * size * a:.1f},{y + 0.9 * size * b:.1f}" for a, b in outline)
    return f'<polygon points="{path}" fill="{colour}" stroke="white" stroke-width="0.8"/>'


def rule(start, end, colour):
    return f'<line x1="{start[0]:.1f}" y1="{start[1]:.1f}" x2="{end[0]:.1f}" y2="{end[1]:.1f}" stroke="{colour}" stroke-width="0.8"/>'


def words(spot, text, size, colour=INK, anchor="start"):
    head = f'<text x="{spot[0]:.1f}" y="{spot[1]:.1f}" font-size="{size}" fill="{colour}" text-anchor="{anchor}">'
    return f"{head}{html.escape(text)}</text>"


def headline(spot, text, size):
    """Bold, in the middle above `spot`."""
    return f'<g font-weight="bold">{words(spot, text, size, INK, "middle")}</g>'


def legend(entries, spot, step):
    """[(name, look)] in one row."""
    out = []
    for k, (name, look) in enumerate(entries):
        x, y = spot[0] + k * step, spot[1]
        dash = f' stroke-dasharray="{look[1]}"' if look[1] else ""
        out.append(f'<line x1="{x}" y1="{y}" x2="{x + 30}" y2="{y}" stroke="{look[0]}" stroke-width="1.8"{dash}/>')
        out.append(marker(look[2], (x + 15, y), 4.0, look[0]))
        out.append(words((x + 37, y + 4), name, 12))
    return out


def page(width, height, parts):
    head = f'<svg xmlns="http://www.w3.org/2000/svg" width="{width}" height="{height}" viewBox="0 0 {width} {height}" {FONT}>'
    return "\n".join([head, f'<rect width="{width}" height="{height}" fill="white"/>', *parts, "</svg>"]) + "\n"


def seconds(value):
    return f"{value:g}"


def percent(value):
    return f"{100 * value:g} %"


def counted(value):
    """12000 as 12k."""
    for size, letter in ((1e9, "G"), (1e6, "M"), (1e3, "k")):
        if value >= size:
            return f"{value / size:g}{letter}"
    return f"{value:g}"
