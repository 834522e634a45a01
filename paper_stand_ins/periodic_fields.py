"""Periodic fields on a square of pixels: random waves, cells, needles, and light on relief.

A field is (n, n), row 0 at the bottom and column 0 at the left. Every function treats its opposite edges as neighbours,
so whatever is made of fields continues across the edges of an image. Lengths are in widths of the square or in pixels.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass
from itertools import product

import numpy as np

from ..support.arrays import Array


def list_wave_numbers(n: int) -> tuple[Array, Array]:
    """Waves per width along the columns (1, n // 2 + 1) and along the rows (n, 1), for ``numpy.fft.rfft2``."""
    return np.fft.rfftfreq(n, 1 / n)[None, :], np.fft.fftfreq(n, 1 / n)[:, None]


def normalise(field: Array) -> Array:
    """The field scaled to mean 0 and standard deviation 1."""
    return np.asarray((field - field.mean()) / field.std())


def smooth_step(field: Array, low: float, high: float) -> Array:
    """0 below ``low``, 1 above ``high``, and smooth between."""
    t = np.clip((field - low) / (high - low), 0.0, 1.0)
    return np.asarray(t * t * (3.0 - 2.0 * t))


def blur(field: Array, sigma_px: float) -> Array:
    """The field, smoothed by a Gaussian."""
    n = len(field)
    k_x, k_y = list_wave_numbers(n)
    gain = np.exp(-2.0 * (math.pi * sigma_px / n) ** 2 * (k_x**2 + k_y**2))
    return np.asarray(np.fft.irfft2(gain * np.fft.rfft2(field), (n, n)))


def sample_wrapped(field: Array, rows: Array, columns: Array) -> Array:
    """The field, interpolated linearly at positions in pixels, which wrap around."""
    n = len(field)
    row, column = np.floor(rows).astype(np.int64), np.floor(columns).astype(np.int64)
    b, a = rows - row, columns - column
    row, column = row % n, column % n
    below, right = (row + 1) % n, (column + 1) % n
    return np.asarray(
        (1 - b) * ((1 - a) * field[row, column] + a * field[row, right])
        + b * ((1 - a) * field[below, column] + a * field[below, right])
    )


def warp_field(field: Array, rows_px: Array, columns_px: Array) -> Array:
    """Warp a field: each pixel gets the value from ``rows_px`` and ``columns_px`` pixels away."""
    axis = np.arange(len(field), dtype=float)
    return sample_wrapped(field, axis[:, None] + rows_px, axis[None, :] + columns_px)


@dataclass(frozen=True)
class Cells:
    """Cells around random points: distances to the nearest point and to the second nearest, the way from the nearest
    (``x`` right, ``y`` up), all in cells, and the number of the cell, all (n, n); and the count of the cells."""

    first: Array
    second: Array
    x: Array
    y: Array
    number: Array
    count: int


class FieldGenerator:
    """Draws random fields of ``n`` x ``n`` pixels from a generator, one after the other."""

    def __init__(self, random: np.random.Generator, n: int) -> None:
        self.random, self.n = random, n

    def make_uniform(self, value: float) -> Array:
        """A field that is the same everywhere."""
        return np.full((self.n, self.n), value)

    def draw_per_cell(self, cells: Cells) -> Array:
        """A random number for each cell, uniform from 0 to 1."""
        return self.random.random(cells.count)[cells.number]

    def draw_normal_per_cell(self, cells: Cells) -> Array:
        """A random number for each cell, with a normal distribution of unit deviation."""
        return self.random.standard_normal(cells.count)[cells.number]

    def waves(
        self, slope: float, shortest: float, longest: float, elongation: float = 1.0, angle: float = 0.0
    ) -> Array:
        """Random waves of unit standard deviation, between two wavelengths in widths.

        The two-dimensional power spectrum falls as wave number^-``slope``. Crests along ``angle`` (radians from the
        columns' axis) are ``elongation`` times as long as they are wide.
        """
        random, n = self.random, self.n
        longest = max(longest, 6.0 / n)  # a small image cannot hold shorter ones
        shortest = min(shortest, longest / 2)
        k_x, k_y = list_wave_numbers(n)
        along = math.cos(angle) * k_x + math.sin(angle) * k_y
        across = -math.sin(angle) * k_x + math.cos(angle) * k_y
        k = np.hypot(along * elongation, across)
        amplitude = np.where((k >= 1 / longest) & (k <= 1 / shortest), np.maximum(k, 0.5) ** (-slope / 2), 0.0)
        return normalise(np.fft.irfft2(amplitude * np.fft.rfft2(random.standard_normal((n, n))), (n, n)))

    def cells(self, across: int, shift: tuple[Array, Array] | None = None, regular: float = 0.0) -> Cells:
        """Cells around ``across``² points, one in each square of a grid.

        ``shift`` (rows, columns), in cells, bends the cells; ``regular`` is 0 for random points, 1 for a square grid.
        """
        random, n = self.random, self.n
        jitter = 0.5 * regular + (1.0 - regular) * random.random((across, across, 2))
        first, second = np.full((n, n), np.inf), np.full((n, n), np.inf)
        number, from_x, from_y = np.zeros((n, n), np.int64), np.zeros((n, n)), np.zeros((n, n))
        for where, dx, dy in _list_nearby_points(n, jitter, shift):
            distance = np.hypot(dx, dy)
            nearer = distance < first
            second = np.where(nearer, first, np.minimum(second, distance))
            number = np.where(nearer, where[0] * across + where[1], number)
            from_x, from_y = np.where(nearer, dx, from_x), np.where(nearer, dy, from_y)
            first = np.where(nearer, distance, first)
        return Cells(first, second, from_x, from_y, number, across**2)

    def facets(self, across: int, tilt: float) -> Array:
        """Heights of tilted flat facets, one for each cell: slopes up to ``tilt``, random levels from 0 to 1."""
        random, n = self.random, self.n
        jitter = random.random((across, across, 2))
        level, slope = random.random((across, across)), tilt * (2.0 * random.random((across, across, 2)) - 1.0)
        top = np.full((n, n), -np.inf)
        for where, dx, dy in _list_nearby_points(n, jitter):
            facet = level[where] + slope[where][..., 0] * dx + slope[where][..., 1] * dy
            # A plate ends at half a cell and falls off steeply.
            top = np.maximum(top, facet - 8.0 * np.maximum(np.hypot(dx, dy) - 0.55, 0.0))
        return top

    def lines(self, count: int, length: float, width_px: float, bend: float, branches: int = 0) -> Array:
        """The share of each pixel that random lines cover, 0 to 1: ``count`` lines of about ``length`` widths.

        A line turns by about ``bend`` radians over its length. Each has ``branches`` shorter and thinner ones.
        """
        random, n = self.random, self.n
        covered = np.zeros((n, n))
        todo = [
            (random.random(2) * n, 2 * math.pi * random.random(), length * (0.5 + random.random()), width_px, branches)
            for _ in range(count)
        ]
        while todo:
            at, heading, long, width, more = todo.pop()
            steps = max(8, round(long * n))
            turn = bend * np.cumsum(random.standard_normal(steps)) / math.sqrt(steps) + heading
            # Broken lines, not curves: a crack keeps its heading for a while.
            hold = max(1, steps // 12)
            turn = np.repeat(turn[::hold], hold)[:steps]
            path = np.stack([at[1] + np.cumsum(np.sin(turn)), at[0] + np.cumsum(np.cos(turn))], axis=1)
            taper = width * np.minimum(1.0, 4.0 * (1.0 - np.arange(steps) / steps))
            reach = math.ceil(width) + 1
            for dy in range(-reach, reach + 1):
                for dx in range(-reach, reach + 1):
                    row, column = np.floor(path[:, 0]).astype(np.int64) + dy, np.floor(path[:, 1]).astype(np.int64) + dx
                    apart = np.hypot(row - path[:, 0], column - path[:, 1])
                    np.maximum.at(covered, (row % n, column % n), np.clip(taper / 2 + 0.5 - apart, 0.0, 1.0))
            for _ in range(more):
                k = random.integers(steps // 6, steps)
                side = 1.0 if random.random() < 0.5 else -1.0
                todo.append(
                    (
                        path[k, ::-1].copy(),
                        turn[k] + side * (0.5 + 0.7 * random.random()),
                        long * 0.45,
                        width * 0.6,
                        more // 2,
                    )
                )
        return covered

    def discs(self, count: int, smallest_px: float, largest_px: float, where: Array | None = None) -> Array:
        """Random round bubbles, 0 outside to 1 in their middle, their number falling as the square of their radius.

        ``where`` is the chance of each pixel to have one.
        """
        random, n = self.random, self.n
        found = np.zeros((n, n))
        radii = smallest_px / np.sqrt(1.0 - random.random(count) * (1.0 - (smallest_px / largest_px) ** 2))
        places = random.random((count, 2)) * n
        kept = random.random(count)
        for radius, (y, x), chance in zip(radii, places, kept, strict=True):
            if where is not None and where[int(y) % n, int(x) % n] < chance:
                continue
            reach = math.ceil(radius) + 1
            rows, columns = np.arange(int(y) - reach, int(y) + reach + 1), np.arange(int(x) - reach, int(x) + reach + 1)
            apart = np.hypot(rows[:, None] - y, columns[None, :] - x)
            part = np.ix_(rows % n, columns % n)
            bubble = np.clip(radius + 0.5 - apart, 0.0, 1.0) * (1.0 - 0.6 * apart / radius).clip(0)
            found[part] = np.maximum(found[part], bubble)
        return found


def _list_nearby_points(
    n: int, jitter: Array, shift: tuple[Array, Array] | None = None
) -> Iterator[tuple[tuple[Array, Array], Array, Array]]:
    """The nine random points around each pixel: row and column in ``jitter`` (k, k, 2), and the way from the point.

    A square of the grid has one point each, at ``jitter`` in it. Ways, all (n, n), are in squares.
    """
    across = len(jitter)
    axis = (np.arange(n) + 0.5) * across / n
    x, y = np.broadcast_to(axis[None, :], (n, n)), np.broadcast_to(axis[:, None], (n, n))
    if shift is not None:
        y, x = y + shift[0], x + shift[1]
    column, row = np.floor(x).astype(np.int64), np.floor(y).astype(np.int64)
    for j, i in product((-1, 0, 1), repeat=2):
        where = (row + j) % across, (column + i) % across
        yield where, x - column - i - jitter[where][..., 0], y - row - j - jitter[where][..., 1]


def find_gradients(height: Array) -> tuple[Array, Array]:
    """Rise of heights in pixels toward the columns and toward the rows, by central differences around the edges."""
    return ((np.roll(height, -1, 1) - np.roll(height, 1, 1)) / 2, (np.roll(height, -1, 0) - np.roll(height, 1, 0)) / 2)


def find_normals(height: Array) -> Array:
    """Unit normals (n, n, 3) of heights in pixels: x to the right, y up the image, z out."""
    x, y = find_gradients(height)
    return np.stack([-x, -y, np.ones_like(x)], axis=-1) / np.sqrt(1.0 + x * x + y * y)[..., None]


def estimate_openness(height: Array, reach_px: float) -> Array:
    """Approximate share of the sky, 0 to 1, that each point of heights in pixels sees over higher ground within
    distances up to ``reach_px``: 1 on crests, less in hollows."""
    hidden = np.zeros_like(height)
    radius, count = 1.5, 0
    while radius <= reach_px:
        hidden += np.arctan(np.maximum(blur(height, radius) - height, 0.0) * 2.0 / radius)
        radius, count = 2.0 * radius, count + 1
    return np.asarray(np.clip(1.0 - 1.3 * hidden / max(count, 1), 0.0, 1.0))


def cast_shadows(height: Array, azimuth: float, elevation: float, reach_px: int) -> Array:
    """Share of sunlight that reaches each point of heights in pixels, 0 to 1, under a Sun at these angles (radians,
    azimuth from the columns' axis) with soft edges."""
    lowest = np.full_like(height, -np.inf)
    for step in range(1, reach_px + 1, max(1, reach_px // 48)):
        rows, columns = round(step * math.sin(azimuth)), round(step * math.cos(azimuth))
        away = math.hypot(rows, columns)
        if away:
            rises = np.roll(height, (-rows, -columns), (0, 1)) - height
            lowest = np.maximum(lowest, np.arctan(rises / away))
    return np.asarray(np.clip((elevation + 0.05 - lowest) / 0.1, 0.0, 1.0))


def light_relief(
    height: Array, sun_deg: tuple[float, float], sky: float = 0.35, scatter_px: float = 0.0, reach_px: int = 96
) -> Array:
    """Light on relief, 1 on level ground: sunlight with cast shadows, and a share ``sky`` from all sides.

    ``sun_deg`` is the azimuth of the Sun, from the columns' axis, and its elevation, both in degrees.
    Half of the sunlight leaves the surface about ``scatter_px`` from where it has entered.
    """
    azimuth, elevation = map(math.radians, sun_deg)
    toward = np.array(
        [math.cos(azimuth) * math.cos(elevation), math.sin(azimuth) * math.cos(elevation), math.sin(elevation)]
    )
    sun = np.maximum(find_normals(height) @ toward, 0.0) / math.sin(elevation)
    sun = sun * cast_shadows(height, azimuth, elevation, reach_px)
    if scatter_px > 0.0:
        sun = (sun + blur(sun, scatter_px)) / 2
    return np.asarray((1.0 - sky) * sun + sky * estimate_openness(height, reach_px / 2))
