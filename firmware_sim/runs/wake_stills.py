"""The recorded wake of a run: still pictures of the flow, one every few control periods. They are small enough to be
stored with every run. Stills are grey, lossy WebP pictures, which every browser can decode."""

import io
import json
from collections.abc import Callable, Mapping
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Final

import numpy as np
import numpy.typing as npt
from PIL import Image, UnidentifiedImageError

from contract.errors import ConfigError, StillwakeError
from contract.npz import read_npz
from contract.release import strict_json
from contract.sensor_layout import SensorLayout
from contract.typed import typed
from firmware_sim.runs.run_log import RunLog
from wake.pictures.fields import LevelPicture, Levels, View

_SCHEMA: Final = "stillwake-wake/1"
MOST_STILLS: Final = 640
"""Largest number of stills in a recording, about 2 MB; in a longer run the intervals between the stills are longer."""
MIDDLE: Final = 128
"""Grey value of level 0."""
_WEBP: Final = {"quality": 85, "method": 2}
_SAME_TIME: Final = 1e-6  # largest difference in t_c of two times that are treated as equal


@dataclass(frozen=True, kw_only=True)
class Scene:
    """The common data of a run's stills: limits of x and y in W, size in pixels, and positions of the sensors in W."""

    view: View
    size: tuple[int, int]
    sensors: Mapping[str, tuple[float, float]]

    @classmethod
    def of(cls, picture: LevelPicture, layout: SensorLayout) -> "Scene":
        places = {name: (float(x), float(y)) for name, (x, y) in zip(layout.names, layout.positions, strict=True)}
        return cls(view=picture.view, size=picture.size, sensors=places)


@dataclass(frozen=True, kw_only=True, eq=False)
class WakeStills:
    """The n stills of a run as WebP files. `k`, shape (n,), has the numbers of the periods at whose starts they were
    taken, in increasing order; `t`, shape (n,), their times in t_c."""

    scene: Scene
    k: npt.NDArray[np.int64]
    t: npt.NDArray[np.float64]
    stills: tuple[bytes, ...]

    def levels(self, index: int) -> Levels:
        """Return the levels of a still, shape (height, width); the lossy codec changes them slightly."""
        with Image.open(io.BytesIO(self.stills[index])) as still:
            grey = np.asarray(still.convert("L"), dtype=np.int16)
        return np.asarray(np.clip(grey - MIDDLE, -127, 127), dtype=np.int8)


class WakeRecorder:
    def __init__(self, scene: Scene, periods: int) -> None:
        self._scene = scene
        self._every = max(1, -(-periods // MOST_STILLS))
        self._kept: list[tuple[int, float, bytes]] = []

    def record(self, k: int, t: float, levels: Callable[[], Levels]) -> None:
        """Record a still at the start of period k, at time t in t_c. Call `levels` only if a still is due."""
        if k % self._every == 0:
            buffer = io.BytesIO()
            grey = np.asarray(levels().astype(np.int16) + MIDDLE, dtype=np.uint8)
            Image.fromarray(grey).save(buffer, format="WEBP", **_WEBP)
            self._kept.append((k, t, buffer.getvalue()))

    def recorded(self) -> WakeStills:
        k, t, stills = zip(*self._kept, strict=True)
        return WakeStills(scene=self._scene, k=np.array(k, dtype=np.int64), t=np.array(t, dtype=float), stills=stills)


def save(path: Path, wake: WakeStills) -> None:
    """Write the stills as .npz; `path` is a temporary file of `contract.atomic.replacing`."""
    header = json.dumps({"schema": _SCHEMA, **asdict(wake.scene)})
    ends = np.cumsum([len(still) for still in wake.stills], dtype=np.int64)
    packed = np.frombuffer(b"".join(wake.stills), dtype=np.uint8)
    with path.open("wb") as file:
        np.savez_compressed(file, header=header, k=wake.k, t=wake.t, ends=ends, stills=packed)


def load(path: Path, log: RunLog) -> WakeStills:
    """Read a file written by `save`. Raises StillwakeError if it is damaged, or of another schema or run."""
    try:
        data = read_npz(path)
        header = strict_json.decode(data.text("header").encode())
        if (schema := header.pop("schema", None)) != _SCHEMA:
            raise ValueError(f"its schema is {schema!r}, but must be {_SCHEMA!r}")
        ends, packed = data.numbers("ends", None).astype(np.int64), data["stills"].tobytes()
        begins = [0, *ends[:-1].tolist()]
        wake = WakeStills(
            scene=typed(header, Scene, complete=True),
            k=data.numbers("k", None).astype(np.int64),
            t=data.numbers("t", None),
            stills=tuple(packed[begin:end] for begin, end in zip(begins, ends.tolist(), strict=True)),
        )
        _check(wake, len(packed), log)
    except (OSError, ValueError, ConfigError) as error:
        raise StillwakeError(f"{path}: not the recorded wake of this run ({error})") from error
    return wake


def _check(wake: WakeStills, total: int, log: RunLog) -> None:
    count = len(wake.stills)
    if not count or wake.k.shape != (count,) or wake.t.shape != (count,):
        raise ValueError(f"there are {count} stills for {len(wake.k)} periods")
    if sum(map(len, wake.stills)) != total:
        raise ValueError("the sizes of the stills do not add up to the size of the stored data")
    times = log.series["t"]
    if wake.k[0] < 0 or wake.k[-1] >= len(times) or (np.diff(wake.k) <= 0).any():
        raise ValueError(f"the periods of the stills must increase and be in 0..{len(times) - 1}")
    if not np.allclose(wake.t, times[wake.k], rtol=0.0, atol=_SAME_TIME):
        raise ValueError("the times of the stills are not in the series")
    for still in wake.stills:
        try:
            size = Image.open(io.BytesIO(still), formats=("WEBP",)).size
        except (UnidentifiedImageError, OSError):
            raise ValueError("a still is not a WebP picture") from None
        if size != wake.scene.size:
            raise ValueError(f"a still has {size} pixels; it must have {wake.scene.size}")
