"""Converts a recording to a dataset of LeRobot, format v3.0, without LeRobot.

An episode is the whole recording, or if it has marks, the time from each mark to the next one; the
text of the mark is its task. A mark ``end`` ends an episode, and the time after it belongs to none.
LeRobot has no agreed format for touch, so the mapping is thin: for each strip, position (0 to 1),
force in N and whether a finger touches, as state and as action, and the six counts as tactile
observation.
"""

import json
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from spots.common.atomic import exists
from spots.errors import FileError, missing
from spots.recording.export import Files, Format, Records
from spots.recording.table import Description
from spots_device.sensor.smux import CHANNELS

_END = "end"
_FPS_MAX = 1000
_DATA = "data/chunk-000/file-000.parquet"
_EPISODES = "meta/episodes/chunk-000/file-000.parquet"
_QUANTILES = {"q01": 0.01, "q10": 0.1, "q50": 0.5, "q90": 0.9, "q99": 0.99}
_N_PER_MN = 1e-3
_INDICES = "frame_index", "episode_index", "index", "task_index"


class _Lane(NamedTuple):
    """Readings of a strip: their times in s, and three values; and times and counts of spectra."""

    times_s: list[float]
    readings: list[tuple[float, float, float]]
    spectra_s: list[float]
    counts: list[tuple[float, ...]]


def write(description: Description, records: Records, out: Path, files: Files) -> None:
    """Write the folder of a dataset, from the rows of a recording's tables.

    FileError if the folder exists, or there are no readings. RequirementError without pyarrow.
    """
    try:
        import pyarrow as pa
        from pyarrow import parquet
    except ImportError:
        raise missing("a dataset of LeRobot needs", "pyarrow", "lerobot") from None
    if out.exists():
        raise exists(out)
    lanes, marks = _read(description, records)
    if not any(lane.times_s for lane in lanes):
        raise FileError("the recording has no readings: record a board that streams touches")
    episodes, fps = _episodes(lanes, marks)
    names = _names(description, lanes)
    features = _features(names)
    tasks = [*dict.fromkeys(task for task, _ in episodes)]
    columns, lengths = _columns(episodes, tasks, fps, names)

    def table(values: Mapping[str, Any]) -> Any:
        return pa.table({name: _array(pa, one) for name, one in values.items()})

    def put(place: str, content: Any) -> None:
        path = out / place
        path.parent.mkdir(parents=True, exist_ok=True)
        file = files.new(path)
        if isinstance(content, dict):
            file.write(json.dumps(content, indent=4).encode())
        else:
            parquet.write_table(content, file)

    files.push(_Undo(out))
    put(_DATA, table(columns))
    put("meta/info.json", _info(features, fps, lengths, len(tasks), description))
    put("meta/stats.json", _stats(columns))
    put("meta/tasks.parquet", _task_table(pa, tasks))
    put(_EPISODES, pa.Table.from_pylist([*_about_episodes(columns, episodes, lengths)]))


class _Undo:
    """Removes the empty folders of a dataset that was not written."""

    def __init__(self, folder: Path):
        self._folder = folder

    def __enter__(self) -> None:
        pass

    def __exit__(self, kind: object, *_: object) -> None:
        if kind is not None and self._folder.exists():
            folders = [one for one in self._folder.rglob("*") if one.is_dir()]
            for one in [*sorted(folders, reverse=True), self._folder]:
                one.rmdir()


def _read(description: Description, records: Records) -> tuple[list[_Lane], list]:
    strips = [info.get("length_um") or 0 for info in description.header.strips]
    lanes = [_Lane([], [], [], []) for _ in strips]
    marks = []
    for table, row in records:
        if table.name == "mark":
            marks.append((row[0], row[-1]))
        elif table.name == "touch" and row[2] < len(lanes):
            values = dict(zip(table.dtype.names, row))
            place_um, force_mN = values["position_um"], values["force_mN"]
            trusted = values["trusted"] and strips[row[2]]
            lane = lanes[row[2]]
            # Without a press the position stays where it was: a dataset has no unknown values.
            last = lane.readings[-1][0] if lane.readings else 0.0
            place = place_um / strips[row[2]] if trusted else last
            force_n = (force_mN or 0) * _N_PER_MN if trusted else 0.0
            lane.times_s.append(row[0])
            lane.readings.append((place, force_n, float(bool(trusted))))
        elif table.name == "spectrum" and row[2] < len(lanes):
            lanes[row[2]].spectra_s.append(row[0])
            lanes[row[2]].counts.append(row[-CHANNELS:])
    return lanes, marks


def _episodes(lanes: Sequence[_Lane], marks: Sequence[tuple[float, str]]) -> tuple[list, int]:
    """Return pairs of task and values, shape (frames, values); and the frames in a second."""
    used = [lane for lane in lanes if lane.times_s]
    first_s = max(lane.times_s[0] for lane in used)
    last_s = min(lane.times_s[-1] for lane in used)
    steps_s = np.diff(used[0].times_s)
    fps = min(max(round(1 / np.median(steps_s)), 1), _FPS_MAX) if len(steps_s) else 1
    marks = marks or [(first_s, "touch the strip")]
    found = []
    for (begin_s, task), (end_s, _) in zip(marks, [*marks[1:], (np.inf, "")]):
        begin_s, end_s = max(begin_s, first_s), min(end_s, last_s + 1 / fps)
        count = int((end_s - begin_s) * fps + 1e-6)
        if task != _END and count > 0:
            times_s = begin_s + np.arange(count) / fps
            state = np.hstack([_held(one.times_s, one.readings, times_s) for one in used])
            sighted = [one for one in used if one.spectra_s]
            tactile = [_held(one.spectra_s, one.counts, times_s) for one in sighted]
            found.append((task, (state, np.hstack(tactile) if tactile else None)))
    if not found:
        raise FileError("no reading is after a mark: mark the beginning of each episode")
    return found, fps


def _held(times_s: list, values: list, at_s: np.ndarray) -> np.ndarray:
    # The newest reading at each time, as a control loop has it.
    newest = np.searchsorted(times_s, at_s + 1e-6, "right") - 1
    return np.asarray(values, np.float32)[np.maximum(newest, 0)]


def _names(description: Description, lanes: Sequence[_Lane]) -> dict[str, list[str]]:
    several = len(lanes) > 1
    state, tactile = [], []
    for number, lane in enumerate(lanes):
        strip = f"strip{number}_" if several else ""
        if lane.times_s:
            state += [f"{strip}{name}" for name in ("position", "force_N", "touching")]
            if lane.spectra_s:
                tactile += [f"{strip}{channel}" for channel in description.channels]
    names = {"action": state, "observation.state": state}
    return names | ({"observation.tactile": tactile} if tactile else {})


def _features(names: Mapping[str, list[str]]) -> dict[str, Any]:
    made: dict[str, Any] = {
        name: {"dtype": "float32", "shape": [len(one)], "names": one} for name, one in names.items()
    }
    made["timestamp"] = {"dtype": "float32", "shape": [1], "names": None}
    return made | {name: {"dtype": "int64", "shape": [1], "names": None} for name in _INDICES}


def _columns(episodes: list, tasks: list, fps: int, names: Mapping) -> tuple[dict, list[int]]:
    lengths = [len(state) for _, (state, _) in episodes]
    state = np.vstack([one for _, (one, _) in episodes])
    columns = {"action": state, "observation.state": state}
    if "observation.tactile" in names:
        columns["observation.tactile"] = np.vstack([one for _, (_, one) in episodes])
    frames = np.concatenate([np.arange(length) for length in lengths])
    columns["timestamp"] = (frames / fps).astype(np.float32)
    columns["frame_index"] = frames
    columns["episode_index"] = np.repeat(np.arange(len(lengths)), lengths)
    columns["index"] = np.arange(len(frames))
    columns["task_index"] = np.repeat([tasks.index(task) for task, _ in episodes], lengths)
    return columns, lengths


def _array(pa: Any, values: np.ndarray) -> Any:
    if values.ndim == 1:
        return pa.array(values)
    flat = pa.array(values.reshape(-1), pa.float32())
    return pa.FixedSizeListArray.from_arrays(flat, values.shape[1])


def _stats(columns: Mapping[str, np.ndarray]) -> dict[str, Any]:
    found = {}
    for name, values in columns.items():
        rows = values.reshape(len(values), -1).astype(np.float64)
        made = {"min": rows.min(0), "max": rows.max(0), "mean": rows.mean(0), "std": rows.std(0)}
        made |= {key: np.quantile(rows, share, axis=0) for key, share in _QUANTILES.items()}
        found[name] = {key: one.tolist() for key, one in made.items()} | {"count": [len(rows)]}
    return found


def _info(
    features: dict, fps: int, lengths: Sequence[int], tasks: int, about: Description
) -> dict[str, Any]:
    return {
        "codebase_version": "v3.0",
        "robot_type": "spots",
        "total_episodes": len(lengths),
        "total_frames": sum(lengths),
        "total_tasks": tasks,
        "chunks_size": 1000,
        "data_files_size_in_mb": 100,
        "video_files_size_in_mb": 200,
        "fps": fps,
        "splits": {"train": f"0:{len(lengths)}"},
        "data_path": "data/chunk-{chunk_index:03d}/file-{file_index:03d}.parquet",
        "video_path": None,
        "features": features,
        "spots": {key: about.header.info.get(key) for key in ("id", "calibration", "length_um")},
    }


def _task_table(pa: Any, tasks: Sequence[str]) -> Any:
    # LeRobot reads it by pandas, with the tasks as index.
    made = pa.table({"task_index": pa.array(range(len(tasks)), pa.int64()), "task": tasks})
    index = {"index_columns": ["task"], "column_indexes": [], "columns": [], "creator": {}}
    index["columns"] = [
        {
            "name": name,
            "field_name": name,
            "pandas_type": kind,
            "numpy_type": kind if kind == "int64" else "object",
            "metadata": None,
        }
        for name, kind in (("task_index", "int64"), ("task", "unicode"))
    ]
    return made.replace_schema_metadata({"pandas": json.dumps(index)})


def _about_episodes(columns: Mapping, episodes: list, lengths: Sequence[int]) -> Iterator[dict]:
    begin = 0
    for number, ((task, _), length) in enumerate(zip(episodes, lengths)):
        part = {name: values[begin : begin + length] for name, values in columns.items()}
        stats = {
            f"stats/{name}/{key}": value
            for name, one in _stats(part).items()
            for key, value in one.items()
        }
        yield {
            "episode_index": number,
            "tasks": [task],
            "length": length,
            "data/chunk_index": 0,
            "data/file_index": 0,
            "dataset_from_index": begin,
            "dataset_to_index": begin + length,
            "meta/episodes/chunk_index": 0,
            "meta/episodes/file_index": 0,
            **stats,
        }
        begin += length


FORMAT = Format("lerobot", write)
