"""Movies of simulated cells: blebs, ruffles and filopodia that come and go."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np

from ..charts import Floats, Size3, check_voxel_size
from ..errors import ParameterError
from ..progress import Progress, silent
from ..provenance import content_hash
from .blebbing import Blebs
from .bodies import Body, StandingBody, draw_body
from .cells import SMALLEST
from .courses import Lifetimes, SignalLaw
from .drifting import draw_poses
from .lamella import draw_lamella
from .microscope import Microscope
from .moments import LivingCell
from .moving import CHANNELS, Floor, SimulatedMovie
from .populating import Draw, Population, populated
from .recording import Recording, Texture
from .room import Room
from .ruffling import ruffling_cell
from .scenes import FIELD_OF_VIEW_UM, MARGIN_VOXELS
from .sprouting import Filopodia

MOVIES = tuple(CHANNELS)
DRAWN, RECORDED = 77, 78  # set the random numbers of movies apart from those of still cells
SMALLEST_BODY_VOXELS = 10
FLOOR_HEIGHT = 0.6
RECURRENCE = 0.35


@dataclass(frozen=True)
class Defaults:
    """What a kind of movie is like where nothing else is asked for."""

    time_step_s: float
    law: SignalLaw
    reach_um: float
    tilt_deg: float | None
    births: float


DEFAULTS = {
    "blebs": Defaults(1.21, SignalLaw(6.0, -1, 0.9, 0.6), 1.7, None, 0.5),
    "ruffles": Defaults(2.27, SignalLaw(0.0, 1, 0.5, 0.35), 0.0, 45.0, 0.0),
    "filopodia": Defaults(2.0, SignalLaw(0.0, 1, 0.9, 0.6), 3.2, None, 0.3),
}
BIRTHS = "births_per_um2_per_min"
USUAL = {
    "ruffle_um_per_min": 4.2,
    "retrograde_um_per_min": 0.8,
    "extension_um_per_min": 9.0,
    "retraction_um_per_min": 6.0,
}
# Arguments that not all kinds have.
ONLY_FOR = {
    "lifetimes": ("blebs",),
    BIRTHS: ("blebs", "filopodia"),
    "ruffle_um_per_min": ("ruffles",),
    "retrograde_um_per_min": ("ruffles",),
    "extension_um_per_min": ("filopodia",),
    "retraction_um_per_min": ("filopodia",),
}


def movie(
    kind: str = "blebs",
    seed: int = 0,
    *,
    timepoints: int = 60,
    size: int = 128,
    voxel_size: Size3 = (0.3, 0.15, 0.15),
    working_voxel_um: float = 0.15,
    time_step: float | None = None,
    drift_um: float = 0.5,
    rotation_deg: float = 0.0,
    bleaching: float = 0.3,
    depth_decay: float = 0.0,
    tilt_deg: float | None = None,
    lag_s: float | None = None,
    correlation: float | None = None,
    lifetimes: Lifetimes | None = None,
    births_per_um2_per_min: float | None = None,
    ruffle_um_per_min: float | None = None,
    retrograde_um_per_min: float | None = None,
    extension_um_per_min: float | None = None,
    retraction_um_per_min: float | None = None,
    microscope: Microscope | None = None,
    progress: Progress | None = None,
) -> SimulatedMovie:
    """Simulate a movie of one cell.

    What happens is drawn at once, in some seconds; frames are made when they are read. The
    same arguments give the same movie, bit for bit on one machine, in whatever order its
    frames are read. The first channel shows the outline of the cell, the second a signal.

    Parameters
    ----------
    kind : str
        ``"blebs"``: blebs expand within about 5 s and are retracted more slowly; some last
        for several cycles. Channels "membrane" and "septin", which leaves the blebs and
        gathers around their necks. The defaults are those of the paper's Fig. 4.
        ``"ruffles"``: on a spread cell, crests travel over the lamella to the middle, merge
        and dissipate; speckles of actin flow the same way more slowly. Channels "CyOFP1"
        (diffuse) and "actin". The defaults are those of the paper's Fig. 5.
        ``"filopodia"``: extend, stay, and retract. Channels "membrane" and "actin".
    seed : int
        Non-negative.
    timepoints : int
        At least 2.
    size : int
        Edge of the cubic working grid in voxels. The cell shrinks with the field of view.
    voxel_size : (float, float, float)
        Of the stack, (z, y, x) in µm.
    working_voxel_um : float
        Of the truth, in µm.
    time_step : float, optional
        Seconds between two timepoints; by default 1.21 (blebs), 2.27 (ruffles), 2 (filopodia).
    drift_um : float
        Largest shift of the cell along an axis, by a smooth random walk.
    rotation_deg : float
        Largest angle by which it turns, at most 10.
    bleaching : float
        Which part of both dyes is gone at the last timepoint; they decay exponentially.
    depth_decay : float
        Which part of the light is lost at the deepest plane; as much of the rest is out of
        focus there. 0: all planes are alike.
    tilt_deg : float, optional
        The cell has a flat bottom, tilted by this angle against the planes of the stack. By
        default 45 for ruffles, and no flat bottom for the others.
    lag_s : float, optional
        How much later than the curvature the signal changes; by default 6 (blebs) or 0.
    correlation : float, optional
        Between 0 and 1: of the signal with the curvature over time, at the lag, on
        protrusions or, of ruffles, at every place of the lamella. Its sign is negative for
        septin. By default 0.9, of ruffles 0.5.
    lifetimes : Lifetimes, optional
        What the lifetimes of blebs are drawn from.
    births_per_um2_per_min : float, optional
        Of new blebs (default 0.5) or filopodia (0.3): a Poisson process on the free area.
    ruffle_um_per_min, retrograde_um_per_min : float, optional
        Speeds along the bottom of the cell: the mean one of ruffles (4.2; each has its own,
        with a standard deviation of 12 %), and that of the flow of actin (0.8).
    extension_um_per_min, retraction_um_per_min : float, optional
        Mean rates of filopodia (9 and 6; each has its own within 20 %).
    microscope : Microscope, optional
        Point-spread function, light, background and noise.
    progress : Progress, optional

    Raises
    ------
    ParameterError
        An argument is unknown, out of its range, or not for this kind of movie.
    InputError
        The voxel size is not one.
    """
    rates = {
        BIRTHS: births_per_um2_per_min,
        "ruffle_um_per_min": ruffle_um_per_min,
        "retrograde_um_per_min": retrograde_um_per_min,
        "extension_um_per_min": extension_um_per_min,
        "retraction_um_per_min": retraction_um_per_min,
    }
    _check_kind(kind, {"lifetimes": lifetimes, **rates})
    defaults = DEFAULTS[kind]
    plan = Plan(
        kind=kind,
        seed=seed,
        timepoints=timepoints,
        size=size,
        voxel_um=working_voxel_um,
        time_step_s=defaults.time_step_s if time_step is None else time_step,
        drift_um=drift_um,
        rotation_deg=rotation_deg,
        tilt_deg=defaults.tilt_deg if tilt_deg is None else tilt_deg,
        law=replace(
            defaults.law,
            lag_s=defaults.law.lag_s if lag_s is None else lag_s,
            correlation=defaults.law.correlation if correlation is None else correlation,
        ),
        lifetimes=(lifetimes or Lifetimes()) if kind == "blebs" else None,
        rates={BIRTHS: defaults.births, **USUAL}
        | {name: rate for name, rate in rates.items() if rate is not None},
    )
    _check(plan, bleaching, depth_decay)
    recording = Recording(
        microscope or Microscope(),
        working_voxel_um,
        check_voxel_size(voxel_size),
        bleaching,
        depth_decay,
        timepoints,
        (seed, MOVIES.index(kind), RECORDED),
    )
    return _drawn(plan, recording, progress or silent())


@dataclass(frozen=True, eq=False)
class Plan:
    """What a movie is drawn from: the arguments of :func:`movie`, with their defaults."""

    kind: str
    seed: int
    timepoints: int
    size: int
    voxel_um: float
    time_step_s: float
    drift_um: float
    rotation_deg: float
    tilt_deg: float | None
    law: SignalLaw
    lifetimes: Lifetimes | None
    rates: Mapping[str, float]

    @property
    def duration_s(self) -> float:
        return (self.timepoints - 1) * self.time_step_s

    @property
    def field_um(self) -> float:
        """Edge of the field of view."""
        return (self.size - 1) * self.voxel_um

    @property
    def middle(self) -> Floats:
        """Of the field of view."""
        return np.full(3, self.field_um / 2)

    @property
    def slack_um(self) -> float:
        """Width at the border that the cell keeps clear at timepoint 0."""
        turning = np.radians(self.rotation_deg) * self.field_um / 3
        return float((MARGIN_VOXELS + 1) * self.voxel_um + self.drift_um + turning)

    @property
    def scale(self) -> float:
        return self.size * self.voxel_um / FIELD_OF_VIEW_UM

    @property
    def half_body_um(self) -> float:
        """Half of what is left for the body in the field of view."""
        reach = DEFAULTS[self.kind].reach_um * self.scale
        if reach > 0:
            reach = max(reach, 7 * self.voxel_um)
        return self.field_um / 2 - self.slack_um - reach

    @property
    def up(self) -> Floats:
        """Up from the flat bottom: against z, tilted towards y."""
        tilt = np.radians(self.tilt_deg or 0.0)
        return np.array([-np.cos(tilt), np.sin(tilt), 0.0])


def _drawn(plan: Plan, recording: Recording, progress: Progress) -> SimulatedMovie:
    """Draw everything that happens."""
    progress(0.0, "Drawing the cell")
    rng = np.random.default_rng([plan.seed, MOVIES.index(plan.kind), DRAWN])
    draw = _ruffling if plan.kind == "ruffles" else _growing
    cell, floor = draw(rng, plan, progress)
    poses = draw_poses(rng, plan.timepoints, plan.middle, plan.drift_um, plan.rotation_deg)
    texture = Texture.draw(rng)
    progress(1.0)
    return SimulatedMovie(
        plan.kind,
        plan.seed,
        cell,
        poses,
        texture,
        recording,
        plan.time_step_s,
        floor,
        plan.lifetimes,
        {name: rate for name, rate in plan.rates.items() if plan.kind in ONLY_FOR[name]},
        content_hash(repr(plan), repr(recording)),
    )


def _growing(
    rng: np.random.Generator, plan: Plan, progress: Progress
) -> tuple[LivingCell, Floor | None]:
    """A round cell with blebs or filopodia."""
    body: Body = draw_body(rng, plan.middle, plan.half_body_um)
    floor = None
    if plan.tilt_deg is not None:
        body = StandingBody.of(body, plan.up, FLOOR_HEIGHT)
        floor = Floor(body.centre - body.floor_um * plan.up, plan.up)
    room = Room(plan.slack_um, plan.field_um - plan.slack_um, 3.5 * plan.voxel_um)
    draw: Draw
    if plan.lifetimes is not None:
        blebs = Blebs(body, plan.lifetimes, plan.scale, plan.voxel_um)
        draw, before = blebs.draw, 4.0 * plan.lifetimes.mean_s
    else:
        filopodia = Filopodia(
            body,
            plan.rates["extension_um_per_min"],
            plan.rates["retraction_um_per_min"],
            plan.scale,
            plan.voxel_um,
        )
        draw, before = filopodia.draw, filopodia.longest_s
    population = Population(body, room, draw, plan.rates[BIRTHS], RECURRENCE, before, plan.law)
    cell = populated(rng, population, plan.duration_s, plan.size, plan.voxel_um, progress)
    return cell, floor


def _ruffling(
    rng: np.random.Generator, plan: Plan, progress: Progress
) -> tuple[LivingCell, Floor | None]:
    """A spread cell with ruffles."""
    lamella = draw_lamella(rng, plan.middle, plan.up, plan.half_body_um)
    cell = ruffling_cell(
        rng,
        lamella,
        plan.law,
        plan.rates["ruffle_um_per_min"],
        plan.rates["retrograde_um_per_min"],
        plan.size,
        plan.voxel_um,
        plan.duration_s,
        progress,
    )
    return cell, Floor(lamella.origin, lamella.up)


# Checks --------------------------------------------------------------------------


def _check_kind(kind: str, given: Mapping[str, object]) -> None:
    if kind not in MOVIES:
        raise ParameterError(
            f"There is no kind of movie {kind!r}.", hint=f"Choose one of {', '.join(MOVIES)}."
        )
    for name, value in given.items():
        if value is not None and kind not in ONLY_FOR[name]:
            raise ParameterError(
                f"A movie of the kind {kind!r} has no {name}.",
                hint=f"It is for {' and '.join(ONLY_FOR[name])}.",
            )


def _check(plan: Plan, bleaching: float, depth_decay: float) -> None:
    for name in ("seed", "timepoints", "size"):
        value = getattr(plan, name)
        if isinstance(value, bool) or not isinstance(value, int | np.integer):
            raise ParameterError(f"{name} is a whole number, not {value!r}.")
    limits = {
        "seed": (plan.seed, 0, 2**63 - 1, ""),
        "timepoints": (plan.timepoints, 2, 100_000, ""),
        "size": (plan.size, SMALLEST, 1024, "voxels"),
        "working_voxel_um": (plan.voxel_um, 1e-3, 10.0, "µm"),
        "time_step": (plan.time_step_s, 1e-3, 3600.0, "s"),
        "drift_um": (plan.drift_um, 0.0, np.inf, "µm"),
        "rotation_deg": (plan.rotation_deg, 0.0, 10.0, "degrees"),
        "tilt_deg": (plan.tilt_deg or 0.0, 0.0, 60.0, "degrees"),
        "lag_s": (plan.law.lag_s, 0.0, 60.0, "s"),
        "correlation": (plan.law.correlation, 0.0, 1.0, ""),
        "bleaching": (bleaching, 0.0, 0.99, ""),
        "depth_decay": (depth_decay, 0.0, 0.95, ""),
        BIRTHS: (plan.rates[BIRTHS], 0.0, 20.0, "per µm² and minute"),
        **{name: (plan.rates[name], 0.01, 100.0, "µm per minute") for name in USUAL},
    }
    for name, (value, low, high, unit) in limits.items():
        if not low <= value <= high:
            raise ParameterError(
                f"{name} is out of its range.",
                **{name: value},
                hint=f"It is between {low:g} and {high:g}{' ' if unit else ''}{unit}.",
            )
    if plan.half_body_um < SMALLEST_BODY_VOXELS * plan.voxel_um:
        raise ParameterError(
            "The field of view is too small for the cell and its drift.",
            size=plan.size,
            drift_um=plan.drift_um,
            half_body_um=plan.half_body_um,
            hint="Use a larger size, or less drift and rotation.",
        )
