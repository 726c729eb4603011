"""A spread cell whose ruffles travel over the lamella, above a slower flow of its actin."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt
from scipy import ndimage

from ..charts import Floats
from ..geometry.rigid import Rigid
from ..progress import Progress
from .courses import Course, Cycle, Lifetimes, SignalLaw
from .growing import LEAST_SIGNAL
from .lamella import Lamella, mean_curvature
from .microscope import TEXTURE, filled
from .moments import Moment, Row, place
from .recording import Texture
from .solids import Field

APART_S = 20.0  # between ruffles that follow each other (paper, Results: about 20 s)
HALF_ANGLES = (0.5, 1.0)
WOBBLE_UM = np.array([0.18, 0.1, 0.05])
SPEED_SPREAD = 0.12
GROWTH_S = 7.0
DISSIPATION_S = 4.0
MERGED_WIDTHS = 2.8  # that close, in widths of the crests, they are one
GAP_WIDTHS = 3.2
LEAST_LABELLED_UM = 0.08
BEFORE_S = 120.0
STATISTICS = 80
LEAST_WINDOW_S = 60.0
WEAKEST = 0.3  # below this part of the usual change of curvature, a place counts as still

SPECKLE_UM, SPECKLE_PERIOD_UM, SPECKLE_SPACING_UM, SPECKLE_COLUMNS = 0.28, 24.0, 0.1, 512
SPECKLES = 0.6  # of the part of the signal that does not follow the curvature


@dataclass(frozen=True, eq=False)
class Ruffle:
    """A crest that travels straight towards the middle of the cell.

    Attributes
    ----------
    identity : int
        In the order of birth; its label in every volume.
    course : Course
        Of its height.
    speed_um_per_min : float
        Along the bottom, of every point of it.
    start_um : float
        Distance from the middle at its birth.
    azimuth, half_angle : float
        Of its middle, and how far it extends to either side.
    height_um, width_um : float
        Of the crest; standard deviation across.
    wobble : ndarray, (3, 2)
        Of its line: amplitudes in µm and phases.
    merged_into : int
        Identity of the ruffle that it runs into and becomes part of, or 0.
    """

    identity: int
    course: Course
    speed_um_per_min: float
    start_um: float
    azimuth: float
    half_angle: float
    height_um: float
    width_um: float
    wobble: Floats
    merged_into: int = 0

    def radius_um(self, time_s: npt.ArrayLike) -> Floats:
        """Distance from the middle of the cell."""
        travelled = self.speed_um_per_min / 60.0 * (np.asarray(time_s) - self.course.birth_s)
        return np.asarray(self.start_um - travelled)


@dataclass(frozen=True, eq=False)
class Crests:
    """The ruffles on a lamella over a whole movie."""

    lamella: Lamella
    ruffles: tuple[Ruffle, ...]

    def at(self, time_s: float) -> tuple[Floats, npt.NDArray[np.int32]]:
        """Height (a, b) in µm of the upper side, and the identity of the ruffle there."""
        height = self.lamella.bare.copy()
        owner = np.zeros(height.shape, np.int32)
        most = np.full(height.shape, LEAST_LABELLED_UM)
        for ruffle in self.ruffles:
            size = float(ruffle.course.size(time_s))
            if size <= 0:
                continue
            pixels, crest = self._crest(ruffle, size, time_s)
            height[pixels] += crest
            higher = crest > most[pixels]
            chosen = tuple(axis[higher] for axis in pixels)
            most[chosen] = crest[higher]
            owner[chosen] = ruffle.identity
        return height, owner

    def _crest(
        self, ruffle: Ruffle, size: float, time_s: float
    ) -> tuple[tuple[npt.NDArray[np.intp], ...], Floats]:
        """The pixels that a ruffle raises, and by how much in µm."""
        radius, azimuth = self.lamella.polar
        middle = float(ruffle.radius_um(time_s))
        reach = 4.0 * ruffle.width_um + float(np.abs(ruffle.wobble[:, 0]).sum())
        angle = (azimuth - ruffle.azimuth + np.pi) % (2 * np.pi) - np.pi
        pixels = np.nonzero((np.abs(radius - middle) < reach) & (np.abs(angle) < ruffle.half_angle))
        position = angle[pixels] / ruffle.half_angle
        waves = np.arange(1, len(ruffle.wobble) + 1) * np.pi * position[:, None]
        line = middle + np.sin(waves + ruffle.wobble[:, 1]) @ ruffle.wobble[:, 0]
        across = (radius[pixels] - line) / ruffle.width_um
        along = (1.0 - position**2) ** 1.5
        return pixels, size * ruffle.height_um * along * np.exp(-0.5 * across**2)


@dataclass(frozen=True, eq=False)
class Speckles:
    """A pattern that flows towards the middle of the cell: (radius, azimuth), periodic."""

    pattern: Floats
    speed_um_per_min: float

    @classmethod
    def draw(cls, rng: np.random.Generator, radius_um: float, speed_um_per_min: float) -> Speckles:
        """Random speckles, round at two thirds of the cell's radius, of unit variance."""
        rows = round(SPECKLE_PERIOD_UM / SPECKLE_SPACING_UM)
        column = 2 * np.pi / SPECKLE_COLUMNS * 2 / 3 * radius_um
        noise = rng.normal(size=(rows, SPECKLE_COLUMNS))
        widths = (SPECKLE_UM / SPECKLE_SPACING_UM, SPECKLE_UM / column)
        pattern = ndimage.gaussian_filter(noise, widths, mode="wrap")
        return cls(pattern / pattern.std(), speed_um_per_min)

    def at(self, polar: tuple[Floats, Floats], time_s: float) -> Floats:
        """The pattern on every pixel of a map."""
        radius, azimuth = polar
        row = (radius + self.speed_um_per_min / 60.0 * time_s) / SPECKLE_SPACING_UM
        column = azimuth * SPECKLE_COLUMNS / (2 * np.pi)
        found: Floats = ndimage.map_coordinates(
            self.pattern, [row, column], order=1, mode="grid-wrap"
        )
        return found


@dataclass(frozen=True, eq=False)
class Standard:
    """What makes the parts of the signal comparable at every place: maps (a, b)."""

    curvature_mean: Floats
    curvature_sd: Floats
    other_mean: Floats
    other_sd: Floats
    slope: Floats


@dataclass(frozen=True, eq=False)
class RufflingCell:
    """A lamella, its ruffles, and the actin in it.

    Actin is enriched where the surface is convex, with the law's correlation over time at
    every place of the lamella. What does not follow the curvature are speckles that flow more
    slowly, and the curvature of ruffles that are not there: it changes in space and time as
    the other part does, so that averaging leaves the correlation as it is.

    Attributes
    ----------
    lamella : Lamella
    crests, absent : Crests
    speckles : Speckles
    law : SignalLaw
    size, voxel_um
        Of the working grid.
    standard : Standard
    """

    lamella: Lamella
    crests: Crests
    absent: Crests
    speckles: Speckles
    law: SignalLaw
    size: int
    voxel_um: float
    standard: Standard

    def moment(self, time_s: float, pose: Rigid) -> Moment:
        """The cell at a time, where a pose puts it."""
        height, owner = self.crests.at(time_s)
        curvature = mean_curvature(height)
        signal = self.signal(time_s)
        return self.lamella.moment(height, owner, signal, curvature, pose, self.size, self.voxel_um)

    def signal(self, time_s: float) -> Floats:
        """Actin over the diffuse dye (a, b), of mean 1."""
        followed = self.crests.at(time_s - self.law.lag_s)[0]
        other = _other(self.absent, self.speckles, time_s)
        change = mean_curvature(followed) - self.standard.curvature_mean
        rest = other - self.standard.other_mean - self.standard.slope * change
        strength = self.law.sign * self.law.correlation
        value = strength * change / self.standard.curvature_sd
        value += np.sqrt(1 - strength**2) * rest / self.standard.other_sd
        signal: Floats = np.maximum(1.0 + self.law.contrast * value, LEAST_SIGNAL)
        return signal

    def dyes(self, moment: Moment, pose: Rigid, texture: Texture) -> tuple[Field, Field]:
        """A dye that is diffuse, and actin."""
        uneven = texture.on_grid(self.size, self.voxel_um, pose)
        diffuse = filled(moment.field, self.voxel_um) * (1 + np.float32(TEXTURE) * uneven)
        return diffuse, diffuse * moment.signal

    def body_points(self, count: int) -> Floats:
        """Points (n, 3) on the body."""
        return self.lamella.samples(count)

    def state(self, time_s: float) -> list[Row]:
        """What is known of every ruffle at a time."""
        return [
            {
                "id": one.identity,
                "height_um": one.height_um * float(one.course.size(time_s)),
                "speed_um_per_min": one.speed_um_per_min,
                "radius_um": float(one.radius_um(time_s)),
                "azimuth_rad": one.azimuth,
                **self._place(one, time_s),
            }
            for one in self.crests.ruffles
            if one.course.size(time_s) > 0
        ]

    def lives(self) -> list[Row]:
        """What is known of every ruffle over its life."""
        return [
            {
                "id": one.identity,
                "birth_s": one.course.birth_s,
                "peak_s": one.course.peak_s,
                "end_s": one.course.end_s,
                "lifetime_s": one.course.lifetime_s,
                "cycles": 1,
                "height_um": one.height_um,
                "speed_um_per_min": one.speed_um_per_min,
                "merged_into": one.merged_into,
                **self._place(one, one.course.peak_s),
            }
            for one in self.crests.ruffles
        ]

    def cycles(self) -> list[Row]:
        """Every ruffle rises once."""
        return [{"id": row.pop("id"), "cycle": 0, **row} for row in self.lives()]

    def _place(self, ruffle: Ruffle, time_s: float) -> Row:
        radius = float(ruffle.radius_um(time_s))
        height = self.lamella.top(radius)
        return place(self.lamella.point(height, radius, ruffle.azimuth))


def _other(absent: Crests, speckles: Speckles, time_s: float) -> Floats:
    """What the signal shows beside the curvature, before it is made comparable."""
    ruffles = mean_curvature(absent.at(time_s)[0])
    zone = absent.lamella.zone
    usual = float(ruffles[zone].std()) + 1e-9
    flowing = speckles.at(absent.lamella.polar, time_s)
    other: Floats = ruffles / usual * np.sqrt(1 - SPECKLES**2) + SPECKLES * flowing
    return other


def ruffling_cell(
    rng: np.random.Generator,
    lamella: Lamella,
    law: SignalLaw,
    ruffle_um_per_min: float,
    retrograde_um_per_min: float,
    size: int,
    voxel_um: float,
    duration_s: float,
    progress: Progress,
) -> RufflingCell:
    """Draw everything that happens between 0 and `duration_s`."""
    crests, absent = (
        Crests(lamella, draw_ruffles(rng, lamella, ruffle_um_per_min, voxel_um, duration_s))
        for _ in range(2)
    )
    speckles = Speckles.draw(rng, lamella.radius_um, retrograde_um_per_min)
    standard = _standard(crests, absent, speckles, law, duration_s, progress)
    return RufflingCell(lamella, crests, absent, speckles, law, size, voxel_um, standard)


def _standard(
    crests: Crests,
    absent: Crests,
    speckles: Speckles,
    law: SignalLaw,
    duration_s: float,
    progress: Progress,
) -> Standard:
    """Means and spreads over the movie at every place; times are visited one by one."""
    times = np.linspace(0.0, max(duration_s, LEAST_WINDOW_S), STATISTICS)
    shape = crests.lamella.bare.shape
    sums = np.zeros((5, *shape))
    for number, time_s in enumerate(times):
        progress(0.9 * number / STATISTICS, "Drawing ruffles")
        curvature = mean_curvature(crests.at(time_s - law.lag_s)[0])
        other = _other(absent, speckles, time_s)
        sums += [curvature, curvature**2, other, other**2, curvature * other]
    mean, square, other_mean, other_square, product = sums / STATISTICS
    variance = np.maximum(square - mean**2, 0.0)
    usual = float(np.median(np.sqrt(variance[crests.lamella.zone])))
    spread = np.sqrt(variance + 1e-12)
    slope = (product - mean * other_mean) / np.maximum(variance, (WEAKEST * usual) ** 2)
    rest = np.maximum(other_square - other_mean**2 - slope**2 * variance, 0.0)
    floor = WEAKEST * float(np.median(np.sqrt(rest[crests.lamella.zone])))
    return Standard(
        mean,
        np.maximum(spread, WEAKEST * usual),
        other_mean,
        np.maximum(np.sqrt(rest), floor),
        slope,
    )


def draw_ruffles(
    rng: np.random.Generator,
    lamella: Lamella,
    speed_um_per_min: float,
    voxel_um: float,
    duration_s: float,
) -> tuple[Ruffle, ...]:
    """Ruffles are born near the edge and travel inwards until they dissipate or merge."""
    scale = lamella.radius_um / 7.0
    per_s = np.pi / np.mean(HALF_ANGLES) / APART_S * 2.5
    lifetimes = Lifetimes(12.0, 40.0, 0.5)
    found: list[Ruffle] = []
    time_s = -max(BEFORE_S, 60.0 * lamella.radius_um / speed_um_per_min)
    while True:
        time_s += float(rng.exponential(1.0 / per_s))
        if time_s > duration_s:
            break
        azimuth, half = rng.uniform(-np.pi, np.pi), rng.uniform(*HALF_ANGLES)
        speed = speed_um_per_min * float(np.clip(rng.normal(1.0, SPEED_SPREAD), 0.7, 1.3))
        start = float(lamella.outline(azimuth)) * rng.uniform(0.76, 0.88)
        end = float(lamella.outline(azimuth)) * rng.uniform(0.42, 0.5)
        life = min(lifetimes.draw(rng), 60.0 * (start - end) / speed)
        width = max(scale * rng.uniform(0.26, 0.34), 1.8 * voxel_um)
        bends = scale * rng.normal(0.0, WOBBLE_UM)
        wobble = np.stack([bends, rng.uniform(0, 2 * np.pi, len(bends))], axis=1)
        ruffle = Ruffle(
            identity=0,
            course=_rise(time_s, life),
            speed_um_per_min=speed,
            start_um=start,
            azimuth=float(azimuth),
            half_angle=float(half),
            height_um=max(scale * rng.uniform(0.9, 1.5), 5 * voxel_um),
            width_um=width,
            wobble=wobble,
        )
        beside = [one for one in found if _beside(one, ruffle) and one.course.end_s > time_s]
        if all(_ahead(one, ruffle) for one in beside):
            found.append(replace(_merging(ruffle, beside), identity=len(found) + 1))
    return tuple(one for one in found if one.course.end_s > 0)


def _rise(birth_s: float, lifetime_s: float) -> Course:
    growth = min(GROWTH_S, 0.25 * lifetime_s)
    times = birth_s + np.array([0.0, growth, 0.5 * lifetime_s, 0.72 * lifetime_s, lifetime_s])
    sizes = np.array([0.0, 0.9, 1.0, 0.85, 0.0])
    cycle = Cycle(birth_s, float(times[2]), birth_s + lifetime_s, 1.0)
    return Course(times, sizes, (cycle,))


def _beside(one: Ruffle, other: Ruffle) -> bool:
    """Whether two ruffles follow each other somewhere."""
    apart = abs((one.azimuth - other.azimuth + np.pi) % (2 * np.pi) - np.pi)
    return apart < 0.8 * (one.half_angle + other.half_angle)


def _ahead(one: Ruffle, born: Ruffle) -> bool:
    """Whether a ruffle is far enough ahead of one that is born."""
    gap = born.start_um - float(one.radius_um(born.course.birth_s))
    return gap > GAP_WIDTHS * (one.width_um + born.width_um) / 2


def _merging(ruffle: Ruffle, ahead: Sequence[Ruffle]) -> Ruffle:
    """A faster ruffle catches up with one ahead, and dissipates into it."""
    course = ruffle.course
    for one in ahead:
        closing = (ruffle.speed_um_per_min - one.speed_um_per_min) / 60.0
        gap = float(ruffle.radius_um(course.birth_s) - one.radius_um(course.birth_s))
        if closing <= 0:
            continue
        met = (
            course.birth_s + (gap - MERGED_WIDTHS * (ruffle.width_um + one.width_um) / 2) / closing
        )
        if met + DISSIPATION_S < min(ruffle.course.end_s, one.course.end_s):
            shorter = _rise(course.birth_s, met + DISSIPATION_S - course.birth_s)
            ruffle = replace(ruffle, course=shorter, merged_into=one.identity)
    return ruffle
