"""The file of a description: a path, a folder, or the name of a model that comes with pinflex."""

from __future__ import annotations

from pathlib import Path

from pinflex.description import schema, sources
from pinflex.description.files import nameable
from pinflex.errors import DescriptionError, ModelNotFoundError, nearest

_PACKAGE = Path(__file__).resolve().parents[1]
_MODEL_FOLDERS = (_PACKAGE / "models", _PACKAGE.parent / "models")


def model_names() -> tuple[str, ...]:
    """Names of the models that come with pinflex."""
    found = (yaml_path for folder in _MODEL_FOLDERS for yaml_path in folder.glob("*/*.yaml"))
    return tuple(sorted({p.stem for p in found if p.stem == p.parent.name}))


def find_file(source: str | Path) -> Path:
    """The file that a path, a folder or the name of a shipped model means."""
    if not isinstance(source, (str, Path)) or "\0" in str(source) or not nameable(Path(source)):
        raise ModelNotFoundError(
            f"{schema.shown(source)}: no model. Give the path of a YAML file, its folder, or a "
            "shipped name."
        )
    path = Path(source)
    shown = str(source)
    if path.is_file():
        if path.suffix.lower() not in (".yaml", ".yml", *sources.READERS):
            raise DescriptionError(
                f'{shown}: not a YAML file. A description is a YAML with "urdf: {path.name}" or '
                "another URDF in it (models/README.md). Give that file."
            )
        return path
    if path.is_dir():
        inside = path / f"{path.resolve().name}.yaml"
        if inside.is_file():
            return inside
        others = [p.name for p in sorted(path.glob("*.yaml"))]
        raise ModelNotFoundError(
            f"{shown}: the folder holds no {inside.name}.{nearest(inside.name, others)} "
            "Give the file itself."
        )
    for folder in _MODEL_FOLDERS:
        shipped = folder / shown / f"{shown}.yaml"
        if shown == path.name and shipped.is_file():
            return shipped
    beside = [p.name for p in sorted(path.parent.glob("*.y*ml"))] if path.parent.is_dir() else []
    known = (*beside, *model_names())
    raise ModelNotFoundError(
        f"{shown}: no such file, folder or shipped model.{nearest(path.name, known)} "
        "Give the path of a YAML file."
    )
