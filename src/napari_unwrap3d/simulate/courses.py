"""What happens to one protrusion over time: how large it is, and the signal that it leads."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
import numpy.typing as npt
from scipy.interpolate import PchipInterpolator
from scipy.special import erf

from ..charts import Floats
from ..errors import ParameterError

NOISE_PERIODS_S = (5.0, 30.0)
NOISE_PERIOD_RATIO = NOISE_PERIODS_S[1] / NOISE_PERIODS_S[0]
NOISE_WAVES = 8
STEP_S = 0.2
RAMP_S = 2.0


@dataclass(frozen=True)
class Lifetimes:
    """The distribution that lifetimes are drawn from: a shifted log-normal one.

    Attributes
    ----------
    least_s : float
        No lifetime is shorter.
    median_s : float
    spread : float
        Standard deviation of the logarithm of what a lifetime exceeds the least by.
    """

    least_s: float = 6.0
    median_s: float = 22.0
    spread: float = 0.6

    def __post_init__(self) -> None:
        if not (0 <= self.least_s < self.median_s < np.inf and 0 <= self.spread <= 2):
            raise ParameterError(
                "These are no lifetimes.",
                least_s=self.least_s,
                median_s=self.median_s,
                spread=self.spread,
                hint="The lifetimes' least is below their median; their spread is 0 to 2.",
            )

    def draw(self, rng: np.random.Generator) -> float:
        """One lifetime in s."""
        more = self.median_s - self.least_s
        return self.least_s + more * float(np.exp(self.spread * rng.normal()))

    def cdf(self, seconds: npt.ArrayLike) -> Floats:
        """Which part of all lifetimes is at most that long."""
        more = np.maximum(np.asarray(seconds, float) - self.least_s, 1e-12)
        deviation = np.log(more / (self.median_s - self.least_s)) / max(self.spread, 1e-9)
        below: Floats = 0.5 * (1.0 + erf(deviation / np.sqrt(2.0)))
        return below

    @property
    def mean_s(self) -> float:
        more = self.median_s - self.least_s
        return float(self.least_s + more * np.exp(0.5 * self.spread**2))


@dataclass(frozen=True)
class Cycle:
    """One extension and retraction.

    Attributes
    ----------
    begin_s, peak_s, end_s : float
    peak : float
        The size at the peak, in parts of the largest of the protrusion.
    """

    begin_s: float
    peak_s: float
    end_s: float
    peak: float


@dataclass(frozen=True, eq=False)
class Course:
    """The size of a protrusion over time, from 0 at its birth to 1 and back to 0.

    Attributes
    ----------
    times_s, sizes : ndarray, (n,)
        Between these the size is interpolated, monotonically.
    cycles : tuple of Cycle
    linear : bool
        The rates between the times are constant.
    """

    times_s: Floats
    sizes: Floats
    cycles: tuple[Cycle, ...]
    linear: bool = False

    @property
    def birth_s(self) -> float:
        return float(self.times_s[0])

    @property
    def end_s(self) -> float:
        return float(self.times_s[-1])

    @property
    def lifetime_s(self) -> float:
        return self.end_s - self.birth_s

    @property
    def peak_s(self) -> float:
        """When it is largest."""
        return max(self.cycles, key=lambda cycle: cycle.peak).peak_s

    def rates(self, height_um: float) -> dict[str, float]:
        """Constant rates in µm/min at which something that high extends and retracts."""
        if not self.linear:
            return {}
        extension, _, retraction = np.diff(self.times_s)
        return {
            "extension_um_per_min": 60.0 * height_um / float(extension),
            "retraction_um_per_min": 60.0 * height_um / float(retraction),
        }

    def size(self, time_s: npt.ArrayLike) -> Floats:
        """Parts of the largest size, 0 before the birth and after the end."""
        times = np.asarray(time_s, float)
        if self.linear:
            return np.asarray(np.interp(times, self.times_s, self.sizes, left=0.0, right=0.0))
        inside = (times > self.birth_s) & (times < self.end_s)
        found = self._curve(np.clip(times, self.birth_s, self.end_s))
        return np.asarray(np.where(inside, found, 0.0))

    @cached_property
    def _curve(self) -> PchipInterpolator:
        return PchipInterpolator(self.times_s, self.sizes)


def draw_cycles(
    rng: np.random.Generator,
    birth_s: float,
    lifetime_s: float,
    expansion_s: float,
    longest_s: float,
) -> Course:
    """A course of cycles: quick expansion, a short plateau, a slower retraction.

    Parameters
    ----------
    rng : numpy.random.Generator
    birth_s, lifetime_s : float
    expansion_s : float
        Of one cycle; less where the cycle is short.
    longest_s : float
        Longer lives have several cycles; between them some of the protrusion remains.
    """
    count = 1 + int(lifetime_s // longest_s)
    lengths = rng.uniform(0.8, 1.2, count)
    lengths *= lifetime_s / lengths.sum()
    peaks = rng.uniform(0.75, 0.95, count)
    peaks[rng.integers(count)] = 1.0
    between = rng.uniform(0.25, 0.4, count)
    times, sizes, cycles = [birth_s], [0.0], []
    for number, (length, peak) in enumerate(zip(lengths, peaks, strict=True)):
        begin = times[-1]
        expanding = min(expansion_s * rng.uniform(0.8, 1.2), 0.3 * length)
        plateau = min(3.0, 0.15 * length)
        last = number == count - 1
        times += [begin + expanding, begin + expanding + plateau / 2]
        sizes += [0.93 * peak, peak]
        cycles.append(Cycle(begin, times[-1], begin + length, float(peak)))
        times += [begin + expanding + plateau, begin + length]
        sizes += [0.93 * peak, 0.0 if last else float(between[number])]
    return Course(np.array(times), np.array(sizes), tuple(cycles))


def straight_course(
    birth_s: float, extension_s: float, stay_s: float, retraction_s: float
) -> Course:
    """A course at constant rates: extension, a stay, retraction."""
    times = birth_s + np.cumsum([0.0, extension_s, stay_s, retraction_s])
    middle = float(times[1] + stay_s / 2)
    cycle = Cycle(birth_s, middle, float(times[3]), 1.0)
    return Course(times, np.array([0.0, 1.0, 1.0, 0.0]), (cycle,), linear=True)


@dataclass(frozen=True)
class SignalLaw:
    """How a signal follows the curvature of the surface.

    Attributes
    ----------
    lag_s : float
        How long after the curvature.
    sign : int
        −1: to where the surface is concave; +1: to where it is convex.
    correlation : float
        Between 0 and 1: of signal and curvature over time, at the lag, in absolute value.
    contrast : float
        How much the signal changes, in parts of its mean.
    """

    lag_s: float
    sign: int
    correlation: float
    contrast: float


@dataclass(frozen=True, eq=False)
class Follower:
    """A value over time that follows another one with a lag and a set correlation.

    It is ``mean + ρ (followed − mean) + √(1 − ρ²) noise``; over its span, the noise is of the
    variance of what is followed and uncorrelated with it.

    Attributes
    ----------
    law : SignalLaw
    amplitudes, periods_s, phases : ndarray, (waves,)
        Of the waves that the noise is made of.
    gain, slope : float
        Of the noise, and of its regression on what is followed, which is taken off.
    mean, noise_mean : float
        Over the span.
    span_s : (float, float)
        Within it the value differs from 0.
    """

    law: SignalLaw
    amplitudes: Floats
    periods_s: Floats
    phases: Floats
    gain: float
    slope: float
    mean: float
    noise_mean: float
    span_s: tuple[float, float]

    def value(self, time_s: npt.ArrayLike, followed: npt.ArrayLike) -> Floats:
        """The value at a time, given what is followed at the time before by the lag."""
        change = np.asarray(followed, float) - self.mean
        angle = 2 * np.pi * np.asarray(time_s, float)[..., None] / self.periods_s + self.phases
        waves = np.cos(angle) @ self.amplitudes
        noise = self.gain * (waves - self.noise_mean - self.slope * change)
        strength = self.law.correlation
        value: Floats = self.mean + strength * change + np.sqrt(1.0 - strength**2) * noise
        return value * self._fade(time_s)

    def _fade(self, time_s: npt.ArrayLike) -> Floats:
        times = np.asarray(time_s, float)
        first, last = self.span_s
        fade: Floats = np.clip(np.minimum(times - first, last - times) / RAMP_S + 1.0, 0.0, 1.0)
        return fade


def draw_follower(
    rng: np.random.Generator, law: SignalLaw, span_s: tuple[float, float], followed: Floats
) -> Follower:
    """A follower of what is given every :data:`STEP_S` from the start of the span."""
    times = span_s[0] + STEP_S * np.arange(len(followed))
    amplitudes = rng.normal(size=NOISE_WAVES)
    periods = NOISE_PERIODS_S[0] * NOISE_PERIOD_RATIO ** rng.uniform(0, 1, NOISE_WAVES)
    phases = rng.uniform(0, 2 * np.pi, NOISE_WAVES)
    waves = np.cos(2 * np.pi * times[:, None] / periods + phases) @ amplitudes
    change = followed - followed.mean()
    slope = float(waves @ change / max(float(change @ change), 1e-12))
    rest = waves - waves.mean() - slope * change
    return Follower(
        law,
        amplitudes,
        periods,
        phases,
        gain=float(change.std() / max(float(rest.std()), 1e-12)),
        slope=slope,
        mean=float(followed.mean()),
        noise_mean=float(waves.mean()),
        span_s=span_s,
    )
