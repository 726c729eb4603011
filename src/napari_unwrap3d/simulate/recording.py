"""From the dyes of one timepoint to what the camera counts: focus, bleaching, noise."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt

from ..charts import Floats, Size3
from ..geometry.rigid import Rigid
from .bodies import random_directions
from .microscope import CORTEX_DEPTH_UM, Microscope, background, blurred, camera, filled
from .solids import Field, refined

TEXTURE_STEP = 4  # voxels between the nodes on which a texture is evaluated
TEXTURE_WAVES = 40
TEXTURE_UM = (2.4, 6.0)
CORTEX_WIDTH_UM = 0.25
INSIDE = 0.25  # concentration of the second dye below the cortex
OUT_OF_FOCUS = 3.0  # how much wider the point-spread function is where nothing is in focus


@dataclass(frozen=True, eq=False)
class Texture:
    """An uneven concentration that moves with the cell: waves (m, 3) and phases (m,)."""

    waves: Floats
    phases: Floats

    @classmethod
    def draw(cls, rng: np.random.Generator) -> Texture:
        """Waves of random directions, a few µm long."""
        lengths = rng.uniform(*TEXTURE_UM, TEXTURE_WAVES)
        waves = random_directions(rng, TEXTURE_WAVES) * (2 * np.pi / lengths)[:, None]
        return cls(waves, rng.uniform(0, 2 * np.pi, TEXTURE_WAVES))

    def on_grid(self, size: int, voxel_um: float, pose: Rigid) -> Field:
        """Of unit variance, on the working grid, where a pose puts the cell."""
        nodes = np.arange(-TEXTURE_STEP, size + 2 * TEXTURE_STEP, TEXTURE_STEP)
        # cos(k · x') of the cell's own x' = Rᵀ(x − shift) is cos((R k) · x − (R k) · shift).
        waves = self.waves @ pose.rotation.T
        phases = self.phases - waves @ pose.translation
        axis = nodes * voxel_um
        z, y, x = (np.exp(1j * np.outer(axis, waves[:, i])) for i in range(3))
        z = z * np.exp(1j * phases)
        plane = z[:, None] * y[None]  # (z, y, waves)
        values = (plane.reshape(-1, len(phases)) @ x.T).real
        unit = values.reshape((len(nodes),) * 3) * np.sqrt(2.0 / len(phases))
        return refined(unit, nodes, size)


def cortical(field: Field, signal: Field, voxel_um: float) -> Field:
    """Concentration of a dye in the cortex that follows a signal, and of what is dissolved."""
    depth = (field + np.float32(CORTEX_DEPTH_UM)) / np.float32(CORTEX_WIDTH_UM)
    dye: Field = np.exp(np.float32(-0.5) * depth * depth) * signal + np.float32(INSIDE)
    return dye * filled(field, voxel_um)


@dataclass(frozen=True, eq=False)
class Recording:
    """How a movie is recorded.

    Attributes
    ----------
    microscope : Microscope
    voxel_um : float
        Of the working grid.
    voxel_size : (float, float, float)
        Of the stack, (z, y, x) in µm.
    bleaching : float
        Which part of the dyes is gone at the last timepoint.
    depth_decay : float
        Which part of the light is out of focus at the deepest plane, and lost there.
    timepoints : int
    seed : tuple of int
        Of the noise; every timepoint has its own.
    """

    microscope: Microscope
    voxel_um: float
    voxel_size: Size3
    bleaching: float
    depth_decay: float
    timepoints: int
    seed: tuple[int, ...]

    def brightness(self, timepoint: int) -> float:
        """Which part of the dyes is left: it decays exponentially."""
        return float((1.0 - self.bleaching) ** (timepoint / (self.timepoints - 1)))

    def image(self, dyes: Sequence[Field], timepoint: int) -> npt.NDArray[np.uint16]:
        """The channels (c, z, y, x) that are recorded of dyes on the working grid."""
        microscope = replace(
            self.microscope, photons=self.microscope.photons * self.brightness(timepoint)
        )
        recorded = []
        for channel, dye in enumerate(dyes):
            light = self._light(dye)
            still = np.random.default_rng([*self.seed, channel])
            beside = background(still, light.shape, self.microscope)
            noise = np.random.default_rng([*self.seed, channel, timepoint])
            recorded.append(camera(light, beside, microscope, noise))
        return np.stack(recorded)

    def _light(self, dye: Field) -> Field:
        """In focus at the first plane, less and less so at the deeper ones."""
        sharp = blurred(dye, self.voxel_um, self.voxel_size, self.microscope)
        if self.depth_decay == 0:
            return sharp
        wide = blurred(dye, self.voxel_um, self.voxel_size, self.microscope, OUT_OF_FOCUS)
        depth = np.linspace(0.0, self.depth_decay, len(sharp), dtype=np.float32)[:, None, None]
        light: Field = (1 - depth) * ((1 - depth) * sharp + depth * wide)
        return light
