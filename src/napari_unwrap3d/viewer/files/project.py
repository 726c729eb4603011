"""Projects in the window: opened into the linked views, and saved with what they look like."""

from __future__ import annotations

import weakref
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from ...atlas import Atlas
from ...charts import Mask, Size3, Stack, Surface
from ...errors import Unwrap3DError
from ...files.movie import is_movie
from ...files.project import load_project, load_source, read_summary, save_project
from ...parameters import Parameters
from ...pipeline import STEP_NAMES, Pipeline, Source
from ..annotations.annotating import annotating_of
from ..common.threads import Task, tell
from ..session import session_of
from ..steps.computing import Known, fingerprint
from ..views.canvas import canvas_of
from ..views.layers import SPACE, UNIT, LayerData, Layout, atlas_charts, chart_layers, mesh_layer
from ..views.sources import LayerSource
from .autosave import Autosave, unsaved_folder
from .view_state import showing_view, view_of

if TYPE_CHECKING:
    from ..session import Session

SOURCE_NAME = "source"


@dataclass(frozen=True, eq=False)
class Opened:
    """A project that was read, ready to be shown.

    Attributes
    ----------
    path : Path
    atlas : Atlas
        With its annotations.
    pipeline : Pipeline
        Whose steps are done, with the parameters of the atlas.
    identity : tuple
        The fingerprint of the source as the layer gives it back.
    origin : (float, float, float)
        Where the coordinate zero of the charts lies, (z, y, x) in µm.
    source_layer : LayerData
        The layer that shows it.
    layers : list of LayerData
        Of every chart.
    view : mapping
        What the window looked like.
    """

    path: Path
    atlas: Atlas
    pipeline: Pipeline
    identity: tuple[Any, ...]
    origin: Size3
    source_layer: LayerData
    layers: list[LayerData]
    view: Mapping[str, Any]

    @property
    def known(self) -> Known:
        """What a session goes on with."""
        shown = dict(atlas_charts(self.atlas))
        return Known(self.pipeline, self.identity, self.origin, shown)


def read_opened(
    path: str | Path,
    atlas: Atlas | None = None,
    parameters: Parameters | None = None,
    origin: Size3 | None = None,
) -> Opened:
    """Read a project and make its layers: what takes long, to be done in a thread.

    Parameters
    ----------
    path : path
    atlas : Atlas, optional
        Of that project, where it was read already.
    parameters : Parameters, optional
        Instead of its own: those of the movie whose common space it is.
    origin : (float, float, float), optional
        Where it lies, (z, y, x) in µm; by default what the file says.

    Raises
    ------
    Unwrap3DError
        As :func:`napari_unwrap3d.load`.
    """
    atlas = load_project(path) if atlas is None else atlas
    source = load_source(path)
    view = read_summary(path)["view"]
    data = _as_layer_holds(atlas.mask if source is None else source)
    atlas = _of_source(atlas, data)
    atlas = atlas if parameters is None else atlas.replaced(parameters=parameters)
    origin = _origin(view) if origin is None else origin
    known = view.get(SOURCE_NAME)
    name = str(known.get("name", "")) if isinstance(known, dict) else ""
    charts = atlas_charts(atlas)
    labels = isinstance(data, Stack) and atlas.parameters.stack.label is not None
    layer = source_layer(data, name or Path(path).stem, origin, labels=labels)
    layout = Layout.of(charts, origin)
    layers = [each for name in reversed(charts) for each in chart_layers(name, charts, layout)]
    pipeline = Pipeline.resumed(atlas, data)
    identity = fingerprint(_as_layer_gives(data, origin))
    return Opened(Path(path), atlas, pipeline, identity, origin, layer, layers, view)


def _as_layer_holds(source: Source) -> Source:
    """What a layer of a source gives back: napari keeps meshes in single precision."""
    if not isinstance(source, Surface):
        return source
    return Surface(source.vertices.astype(np.float32).astype(np.float64), source.faces)


def _as_layer_gives(source: Source, origin: Size3) -> LayerSource:
    """What the layer of a source is read as: the origin of a mask is where its layer lies."""
    if not isinstance(source, Mask):
        return LayerSource(source, origin)
    z, y, x = np.add(source.origin, origin).tolist()
    return LayerSource(Mask(source.data, source.voxel_size), (z, y, x))


def _of_source(atlas: Atlas, source: Source) -> Atlas:
    """The atlas with parameters for the source as it was kept: without a t axis."""
    if not isinstance(source, Stack) or "t" in source.axes or not atlas.parameters.stack.timepoint:
        return atlas
    return atlas.replaced(parameters=atlas.parameters.changed("stack", {"timepoint": 0}))


def _origin(view: Mapping[str, Any]) -> Size3:
    """Where the source lay, (z, y, x) in µm; zero unless the file says something sensible."""
    known = view.get(SOURCE_NAME)
    given = known.get("origin_um", ()) if isinstance(known, dict) else ()
    try:
        z, y, x = np.asarray(given, dtype=np.float64).tolist()
    except (ValueError, TypeError):
        return (0.0, 0.0, 0.0)
    return (z, y, x) if np.isfinite((z, y, x)).all() else (0.0, 0.0, 0.0)


def source_layer(
    source: Source, name: str, origin: Size3 = (0.0, 0.0, 0.0), *, labels: bool = False
) -> LayerData:
    """The layer that shows a source, and of which it can be unwrapped again.

    Parameters
    ----------
    source : Stack, Mask or Surface
    name : str
    origin : (float, float, float)
        Where it lies, (z, y, x) in µm.
    labels : bool
        Whether a stack is a label image.
    """
    attributes: dict[str, Any] = {"name": name, "visible": False}
    if isinstance(source, Surface):
        data, mesh, kind = mesh_layer(source, name)
        return data, {**mesh, **attributes, "translate": origin}, kind
    extra = len(source.axes) - 3 if isinstance(source, Stack) else 0
    place = np.add(source.origin, origin) if isinstance(source, Mask) else origin
    attributes |= {
        "scale": (*(1.0,) * extra, *source.voxel_size),
        "translate": (*(0.0,) * extra, *place),
        "units": (*("pixel",) * extra, *(UNIT,) * 3),
        "axis_labels": tuple(source.axes) if isinstance(source, Stack) else SPACE,
    }
    return source.data, attributes, "labels" if labels else "image"


def open_project(viewer: Any, path: str | Path) -> None:
    """Open a project in a window: the same layers, views, annotations and states of the steps.

    It is read in a thread; what is wrong with it is shown as a notification.

    Parameters
    ----------
    viewer : napari.Viewer
    path : path
        A ``*.unwrap3d`` file; that of a movie, or its folder, is opened as one.
    """
    from ..movies.project import open_movie
    from ..wizard import open_wizard

    if is_movie(path):
        open_movie(viewer, path)
        return
    viewer = getattr(viewer, "__wrapped__", viewer)
    session = session_of(viewer)
    if session.running:
        raise Unwrap3DError("A run is in progress.", hint="Cancel it, then open the project.")
    open_wizard(viewer)
    canvas_of(viewer)
    session.told.emit(f"Opening {Path(path).name} …")
    task = Task(read_opened, path)
    task.returned.connect(partial(_show, weakref.ref(viewer)))
    task.failed.connect(partial(_not_opened, weakref.ref(viewer)))
    session.opening = task
    task.start()


def _show(viewer: weakref.ref[Any], opened: Opened) -> None:
    there = viewer()
    if there is None:
        return
    session_of(there).turns.add(_showing(there, opened))


def _showing(there: Any, opened: Opened) -> Iterator[None]:
    """Show an opened project, a piece per turn of the event loop."""
    yield from adopting(there, opened)
    session = session_of(there)
    session.project_path = None if opened.path.parent == unsaved_folder() else opened.path
    session.turns.add(_look(there, opened))


def adopting(there: Any, opened: Opened, until: str = STEP_NAMES[-1]) -> Iterator[None]:
    """Put an opened cell in the place of the one that is shown."""
    from napari.layers import Layer

    session = session_of(there)
    # The first layer with units of a process makes napari read all units that there are.
    layer = Layer.create(*opened.source_layer)
    yield
    there.layers.append(layer)
    yield
    session.adopt(opened.known, opened.atlas, layer, opened.layers, until)


def _look(there: Any, opened: Opened) -> Iterator[None]:
    yield from looking(there, opened)
    session_of(there).told.emit(f"Opened {opened.path.name}.")
    yield


def looking(there: Any, opened: Opened) -> Iterator[None]:
    """When everything is there: make the window look as it did."""
    if opened.atlas.annotated is not None and opened.atlas.annotations.names:
        annotating_of(there)
        yield
    yield from showing_view(there, opened.view)
    autosave_of(there).opened(opened.path)


def _not_opened(viewer: weakref.ref[Any], error: BaseException) -> None:
    there = viewer()
    if there is not None:
        session_of(there).told.emit("")
    tell(error)


_AUTOSAVES: weakref.WeakKeyDictionary[Any, Autosave] = weakref.WeakKeyDictionary()


def autosave_of(viewer: Any) -> Autosave:
    """What saves the annotations of a viewer by itself; made when it is first asked for."""
    viewer = getattr(viewer, "__wrapped__", viewer)
    if viewer not in _AUTOSAVES:
        session, there = session_of(viewer), weakref.ref(viewer)
        _AUTOSAVES[viewer] = Autosave(session, lambda path: saving(session, there(), path))
    return _AUTOSAVES[viewer]


def saving_task(viewer: Any, path: str | Path) -> Task:
    """A task that saves the cell of a window; what comes of it is known without a wizard, too.

    Parameters
    ----------
    viewer : napari.Viewer
    path : path
        A ``*.unwrap3d`` file.

    Returns
    -------
    Task
        Not started. Errors of it are shown as notifications.
    """
    session, there = session_of(viewer), weakref.ref(viewer)
    task = session.saving = Task(saving(session, viewer, path))
    task.returned.connect(partial(_saved, there))
    task.failed.connect(tell)
    return task


def _saved(viewer: weakref.ref[Any], path: Path) -> None:
    there = viewer()
    if there is not None:
        session_of(there).project_path = path
        autosave_of(there).saved(path)


def saving(session: Session, viewer: Any, path: str | Path) -> Callable[[], Path]:
    """What saves the cell of a session, to be called in a thread; its state is taken now.

    Parameters
    ----------
    session : Session
        With an atlas.
    viewer : napari.Viewer
    path : path
    """
    atlas = session.atlas
    assert atlas is not None
    annotated = atlas.annotated
    state = None if annotated is None else annotated.state()
    source, view = session.source_data, project_view(session, viewer)

    def save() -> Path:
        return save_project(atlas, path, annotations=state, view=view, source=source)

    return save


def project_view(session: Session, viewer: Any) -> dict[str, Any]:
    """What the window looks like, and where the source lies in it."""
    layer = session.source
    origin = session.run_origin
    name = "" if layer is None else str(layer.name)
    return {**view_of(viewer), SOURCE_NAME: {"name": name, "origin_um": list(origin)}}
