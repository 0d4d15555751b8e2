"""Mesh files: the file for a name in a URDF, and its triangles, with the colours and images of the file.

trimesh reads the files, with pycollada for COLLADA.
"""

from __future__ import annotations

import io
import os
import re
import warnings
from collections.abc import Iterator, Sequence
from functools import lru_cache
from pathlib import Path
from typing import Any, NamedTuple
from urllib.parse import unquote

import numpy as np
from numpy.typing import NDArray

from ..urdf.sources import read_source
from ..urdf.strict_xml import StrictReader

Array = NDArray[np.float64]
Color = tuple[float, float, float, float]  # red, green, blue, opacity, each from 0 to 1
Folder = str | os.PathLike[str]

SEARCHED = ("ROS_PACKAGE_PATH", "AMENT_PREFIX_PATH", "CMAKE_PREFIX_PATH")  # variables that list folders of packages
STEPS = 2**20  # of the longest side of a mesh: vertices nearer than one are merged
CREASE = 0.5  # rad: edges sharper than this are drawn sharp


class NotDrawnError(Exception):
    """A part of the geometry cannot be drawn; the message has the reason."""


def find_mesh(name: str, home: Path | None, package_dirs: Sequence[Folder] = ()) -> Path | None:
    """The file for a mesh name of a URDF, or None.

    ``package://PACKAGE/...``, with two or three slashes, and ``model://`` are searched in ``package_dirs``, in the
    folders of ROS_PACKAGE_PATH, AMENT_PREFIX_PATH and CMAKE_PREFIX_PATH, and in the folders above the URDF; a folder
    counts if it holds PACKAGE or has its name. ``file://`` is a path; any other name is relative to the URDF, else to
    ``package_dirs``.

    Raises  NotDrawnError for a name with ``..`` after ``package://`` or ``model://``, percent-encoded or not, which
            leaves the package.
    """
    scheme, colon, rest = name.partition("://")
    if not colon:
        places = [*([home.parent] if home is not None else []), *map(Path, package_dirs)]
        return next((place / name for place in places if (place / name).is_file()), None)
    if scheme == "file":
        return Path(rest) if Path(rest).is_file() else None
    if scheme not in ("package", "model"):
        return None
    if ".." in re.split(r"[/\\]", unquote(rest)):
        raise NotDrawnError(f"{name} holds .., expected a path below its package")
    package, *inner = [part for part in rest.split("/") if part] or [""]
    for folder in (*map(Path, package_dirs), *_listed_folders(), *(home.parents if home is not None else ())):
        for base in (folder / package, *([folder] if folder.name == package else [])):
            place = base.joinpath(*inner)
            if inner and folder in place.parents and place.is_file():  # a drive of Windows would begin a path anew
                return place
    return None


def mesh_path(name: str, home: Path | None, package_dirs: Sequence[Folder] = ()) -> str:
    """The path of the file that ``find_mesh`` finds, "" for none."""
    try:
        found = find_mesh(name, home, package_dirs)
    except NotDrawnError:
        return ""
    return "" if found is None else os.fspath(found)


def triangles_of(contents: bytes, kind: str) -> tuple[Array, NDArray[np.int64]]:
    """Vertices and faces in the contents of a mesh file, of a format by its ending. Raises NotDrawnError."""
    import trimesh

    try:
        made: Any = trimesh.load(io.BytesIO(contents), file_type=kind, force="mesh", process=False)
    except Exception as error:  # of any reader of any format
        raise NotDrawnError(f"a mesh of format {kind} cannot be read: {said(error)}") from error
    if not len(made.faces):
        raise NotDrawnError(f"a mesh of format {kind} cannot be read: it holds no triangles")
    return np.asarray(made.vertices), np.asarray(made.faces)


def _listed_folders() -> Iterator[Path]:
    """Folders of the environment's variables, and ``share`` in each of them."""
    for variable in SEARCHED:
        for folder in filter(None, os.environ.get(variable, "").split(os.pathsep)):
            yield Path(folder)
            yield Path(folder, "share")


class NamedMeshes(NamedTuple):
    """The meshes that a URDF names.

    names      of the files, each once
    visual     number of <visual>s that are meshes
    collision  number of <collision>s that are meshes
    missing    the names without a file, with the reason
    faulty     the names of COLLADA files with dangling references, with these references
    """

    names: list[str]
    visual: int
    collision: int
    missing: list[str]
    faulty: list[str]


def named_meshes(source: str, package_dirs: Sequence[Folder] = ()) -> NamedMeshes:
    """The meshes that a URDF file names; ``source``: its path, "" for none. No geometry is read."""
    if not os.path.isfile(source):
        return NamedMeshes([], 0, 0, [], [])
    path, data = read_source(Path(source))
    robot = StrictReader(Path(path).name, None).outermost(data)
    named = {kind: robot.findall(f"link/{kind}/geometry/mesh") for kind in ("visual", "collision")}
    names = list(dict.fromkeys(mesh.get("filename", "") for meshes in named.values() for mesh in meshes))
    missing, faulty = [], []
    for name in names:
        try:
            found = find_mesh(name, Path(path), package_dirs)
        except NotDrawnError as error:
            missing.append(str(error))
            continue
        if found is None:
            missing.append(f"{name} is not found")
        elif found.suffix.lower() == ".dae" and (lost := list(lost_references(found))):
            faulty.append(f"{name}: {', '.join(lost)}")
    return NamedMeshes(names, len(named["visual"]), len(named["collision"]), missing, faulty)


def lost_references(path: Path) -> Iterator[str]:
    """The dangling references of a COLLADA file: surfaces, images, effects, materials, geometries, in words.

    Source: COLLADA 1.4.1 specification (2008), <sampler2D>, <surface>, <image>, <instance_*>.
    """
    from lxml import etree

    try:
        parser = etree.XMLParser(resolve_entities=False, no_network=True, load_dtd=False, huge_tree=True)
        root = etree.parse(os.fspath(path), parser).getroot()
    except (OSError, etree.XMLSyntaxError) as error:
        yield said(error)
        return
    ids = {x.get("id") for x in root.iter("{*}*") if x.get("id")}
    for effect in root.iter("{*}effect"):
        surfaces = {x.get("sid") for x in effect.iter("{*}newparam") if x.find("{*}surface") is not None}
        for name in (x.text or "" for x in effect.iterfind(".//{*}sampler2D/{*}source")):
            if name.strip() not in surfaces:
                yield f'no surface "{name.strip()}" of a texture'
        for name in (x.text or "" for x in effect.iterfind(".//{*}surface/{*}init_from")):
            if name.strip() not in ids:
                yield f'no image "{name.strip()}" of a texture'
    for name in (x.text or "" for x in root.iterfind(".//{*}image/{*}init_from")):
        place = unquote(name.strip()).removeprefix("file://")
        if place and "://" not in place and not (path.parent / place).is_file():
            yield f'no image file "{name.strip()}"'
    for kind, key in (("effect", "url"), ("geometry", "url"), ("material", "target")):
        for x in root.iter(f"{{*}}instance_{kind}"):
            name = x.get(key, "")
            if name.startswith("#") and name[1:] not in ids:
                yield f'no {kind} "{name[1:]}"'


class MeshFile(NamedTuple):
    """The contents of a mesh file.

    parts  (vertices, faces, the file's own colour, textured mesh) of each part
    fault  the broken elements of a file whose parts are sound; else empty
    """

    parts: list[tuple[Array, NDArray[np.int64], Color | None, Any]]
    fault: str


@lru_cache(maxsize=256)
def read_mesh(path: str, name: str, changed: int) -> MeshFile:
    """A mesh file, ``changed`` at some time, under the name of messages. Raises NotDrawnError."""
    import trimesh

    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            loaded, fault = _loaded(path)
    except Exception as error:  # of any reader of any format
        raise NotDrawnError(f"{name} cannot be read ({said(error)})") from error
    unit = str(loaded.units or "").partition(" * meters")  # of COLLADA, where it is not a metre
    scale = float(unit[0]) if unit[1] else 1.0
    parts = []
    for node in loaded.graph.nodes_geometry:
        X, key = loaded.graph[node]
        mesh = loaded.geometry[key]
        if not isinstance(mesh, trimesh.Trimesh) or not len(mesh.faces):
            continue
        X = np.diag([scale, scale, scale, 1.0]) @ X
        vertices, faces = moved(np.asarray(mesh.vertices), X), np.asarray(mesh.faces)
        if np.linalg.det(X[:3, :3]) < 0.0:
            faces = faces[:, ::-1]
        visual: Any = mesh.visual
        material = getattr(visual, "material", None)
        image = getattr(material, "image", None) or getattr(material, "baseColorTexture", None)
        texture = mesh.copy().apply_transform(X) if image is not None and visual.uv is not None else None
        color: Color | None = None
        if material is not None or visual.defined:
            r, g, b, opacity = (np.asarray((material or visual).main_color) / 255.0).tolist()
            color = (r, g, b, opacity)
        parts.append((*creased(vertices, faces), color, texture))
    if not parts:
        raise NotDrawnError(f"{name} holds no triangles" + f" ({fault})" * bool(fault))
    return MeshFile(parts, f"{name}: {fault}" if fault else "")


def _loaded(path: str) -> tuple[Any, str]:
    """trimesh's scene of a file, and its broken elements; vertices are not merged, which would take most of the time.

    trimesh silently leaves out a mesh whose COLLADA material is broken: so the first reading refuses broken elements,
    and a second one reads the file without the broken materials.
    """
    import trimesh

    if Path(path).suffix.lower() != ".dae":
        return trimesh.load_scene(path, process=False), ""
    try:
        return trimesh.load_scene(path, process=False, ignore_broken=False), ""
    except Exception as error:  # of pycollada, about any element
        import collada

        document = collada.Collada(path, ignore=[collada.common.DaeError])
        sound = {f"#{material.id}" for material in document.materials}
        tree = document.xmlnode
        for parent in list(tree.iter()):
            for child in list(parent):
                if str(child.tag).endswith("}instance_material") and child.get("target") not in sound:
                    parent.remove(child)
        mended = io.BytesIO()
        tree.write(mended)
        mended.seek(0)
        resolver = trimesh.resolvers.FilePathResolver(path)
        return trimesh.load_scene(mended, file_type="dae", resolver=resolver, process=False), said(error)


def glb(mesh: Any, X: Array) -> bytes:
    """A textured mesh, moved by X, in the format GLB."""
    return bytes(mesh.copy().apply_transform(X).export(file_type="glb"))


def creased(vertices: Array, faces: NDArray[np.int64]) -> tuple[Array, NDArray[np.int64]]:
    """The mesh with separate vertices on the two sides of an edge sharper than CREASE, so that its shading is sharp.

    Around a vertex, all faces whose normals agree with the first face within CREASE share one copy of the vertex; of
    the remaining faces, those that agree with the next share another, and so on. Copies of a vertex that the mesh has
    already are merged first.
    """
    low, high = vertices.min(0), vertices.max(0)
    grid = np.rint((vertices - low) * (STEPS / max(float((high - low).max()), 1e-300))).astype(np.int64)
    _, one, same = np.unique(grid @ [1, STEPS + 1, (STEPS + 1) ** 2], return_index=True, return_inverse=True)
    vertices, faces = vertices[one], same.reshape(-1)[faces]
    a, b, c = vertices[faces[:, 0]], vertices[faces[:, 1]], vertices[faces[:, 2]]
    normals = np.cross(b - a, c - a).astype(np.float32)
    normals /= np.maximum(np.linalg.norm(normals, axis=1, keepdims=True), np.finfo(np.float32).tiny)
    order = np.argsort(faces.ravel(), kind="stable")
    at, face = faces.ravel()[order], order // 3
    group, left, level = np.zeros(len(at), np.int64), np.arange(len(at)), 0
    while len(left):
        first = np.flatnonzero(np.diff(at[left], prepend=-1))
        lead = np.repeat(face[left[first]], np.diff(first, append=len(left)))
        agrees = np.einsum("ij,ij->i", normals[face[left]], normals[lead]) >= np.cos(CREASE)
        agrees[first] = True
        group[left[agrees]] = level
        left, level = left[~agrees], level + 1
    copies, where = np.unique(at * level + group, return_inverse=True)
    made = np.empty(len(order), np.int64)
    made[order] = where.reshape(-1)
    return vertices[copies // level], made.reshape(-1, 3)


def moved(vertices: Array, X: Array) -> Array:
    """Points (n, 3) moved by an affine X (4, 4)."""
    return np.asarray(vertices @ X[:3, :3].T + X[:3, 3])


def said(error: Exception) -> str:
    """The first line of an error, or its type."""
    return str(error).strip().partition("\n")[0] or type(error).__name__
