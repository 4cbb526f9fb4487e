"""Measurements from arrays and data frames."""

from collections.abc import Mapping

import numpy as np

from . import _native
from ._native import InputError

_MOST = 2**63 - 1
_MOST_REPEATS = 2**31 - 1
_SMALLEST_SIGMA = 1e-15  # [m] as in files


def _plain(values):
    """A nullable column of pandas as an array of numpy: numbers with NaN, labels and other words with None."""
    if isinstance(values, np.ndarray) or not hasattr(values, "to_numpy"):
        return values
    kind = getattr(getattr(values, "dtype", None), "kind", None)
    if kind is None or not hasattr(values, "isna"):
        return values.to_numpy()
    missing = np.asarray(values.isna())
    if not missing.any():
        return np.asarray(values.to_numpy(dtype=values.dtype.numpy_dtype if hasattr(values.dtype, "numpy_dtype") else None))
    if kind in "iuf":
        return values.to_numpy(dtype=np.float64, na_value=np.nan)
    array = np.array(values, dtype=object)
    array[missing] = None
    return array


def _numbers(values, name):
    _refuse_masked(values, name)
    array = np.asarray(_plain(values))
    if array.dtype.kind not in "iuf":
        raise TypeError(f"{name}: an array of {array.dtype}, expected one of real numbers")
    return np.asarray(array, dtype=np.float64, order="C")


def _refuse_masked(values, name):
    if np.ma.is_masked(values):
        raise InputError(f"{name}: masked values, expected NaN or no row for what was not measured")


class _Places:
    """Where the value of a row stands in the arrays that were given."""

    def __init__(self, row=None, target=None, of_targets=()):
        self._row, self._target, self._of_targets = row, target, of_targets

    def __call__(self, name, i):
        if self._row is None or name == "points":
            return f"{name}[{i}]"
        return f"{name}[{self._row[i]}]" + (f"[{self._target[i]}]" if name in self._of_targets else "")


_AS_GIVEN = _Places()


def _refuse_first(array, name, wrong, place=_AS_GIVEN):
    """Names the first element that is wrong."""
    places = np.argwhere(wrong)
    if len(places):
        where = place(name, places[0][0]) if len(places[0]) else name
        rest = "".join(f"[{i}]" for i in places[0][1:])
        raise InputError(f"{where}{rest}: {array[tuple(places[0])]}, expected a finite number")


def _shaped(values, name, shape, place=_AS_GIVEN):
    """Finite numbers of this shape."""
    array = _numbers(values, name)
    if array.shape != shape:
        raise InputError(f"{name}: an array of shape {array.shape}, expected {shape}")
    _refuse_first(array, name, ~np.isfinite(array), place)
    return array


def _numbered(labels):
    """Names in the order of their first appearance, and the index of each label among them."""
    names, first, index = np.unique(labels, return_index=True, return_inverse=True)
    order = np.argsort(first)
    rank = np.empty_like(order)
    rank[order] = np.arange(len(order))
    return [str(name) for name in names[order]], rank[index.reshape(-1)].astype(np.int64)


def _labels(values, name, count, default, place=_AS_GIVEN):
    """One label for each row; a single text, or nothing, stands for all."""
    if values is None or isinstance(values, str):
        return np.full(count, values or default)
    labels = np.asarray(values, dtype=None if isinstance(values, np.ndarray) else object)
    if labels.shape != (count,):
        raise InputError(f"{name}: an array of shape {labels.shape}, expected {(count,)}, one for each row")
    if labels.dtype.kind in "Of":  # which may hold what stands for no value
        for i, label in enumerate(labels):
            if not isinstance(label, str) and str(label) in ("None", "nan", "<NA>", "NaT"):
                raise InputError(f"{place(name, i)}: {label}, expected a label")
    return labels.astype(str)


def _configurations(joints, labels, place):
    """Names, the configuration of each row, and the first row of each configuration."""
    if labels is None:  # rows with equal joint values are one configuration
        rows = np.ascontiguousarray(joints + 0.0).view(np.dtype((np.void, joints.dtype.itemsize * joints.shape[1])))
        names, index = _numbered_rows(rows.reshape(-1))
    else:
        names, index = _numbered(_labels(labels, "configurations", len(joints), "", place))
    first = np.full(len(names), -1, dtype=np.int64)
    first[index[::-1]] = np.arange(len(index))[::-1]
    differ = np.flatnonzero((joints != joints[first[index]]).any(axis=1))
    if len(differ):
        row = differ[0]
        raise InputError(
            f"{place('joints', row)}: other joint values than in {place('joints', first[index[row]])} of configuration "
            f"{names[index[row]]}, expected the same, or another label"
        )
    return names, index, first


def _numbered_rows(rows):
    _, first, index = np.unique(rows, return_index=True, return_inverse=True)
    rank = np.empty(len(first), dtype=np.int64)
    rank[np.argsort(first)] = np.arange(len(first))
    return [str(i + 1) for i in range(len(first))], rank[index.reshape(-1)]


def _repeats(configuration, target, targets):
    """1 for the first row of a target in a configuration, 2 for the next."""
    group = configuration * targets + target
    order = np.argsort(group, kind="stable")
    ordered = group[order]
    starts = np.flatnonzero(np.r_[True, ordered[1:] != ordered[:-1]])
    lengths = np.diff(np.r_[starts, len(ordered)])
    repeats = np.empty(len(group), dtype=np.int64)
    repeats[order] = np.arange(len(ordered)) - np.repeat(starts, lengths) + 1
    return repeats


def _refuse_twice(rows, place):
    _, first, index = np.unique(rows, axis=0, return_index=True, return_inverse=True)
    again = np.flatnonzero(first[index.reshape(-1)] != np.arange(len(rows)))
    if len(again):
        raise InputError(
            f"{place('repeats', again[0])}: {rows[again[0], 3]}, as in "
            f"{place('repeats', first[index.reshape(-1)[again[0]]])} of this configuration and target, expected a number "
            "for each"
        )


def _integers(values, name, count, place=_AS_GIVEN):
    if values is None:
        return None
    array = np.asarray(values)
    if array.dtype.kind == "f" and array.shape == (count,) and np.isnan(array).any():
        row = np.flatnonzero(np.isnan(array))[0]
        raise InputError(f"{place(name, row)}: {array[row]}, expected an integer")
    if array.dtype.kind not in "iu":
        raise TypeError(f"{name}: an array of {array.dtype}, expected one of integers")
    if array.shape != (count,):
        raise InputError(f"{name}: an array of shape {array.shape}, expected {(count,)}")
    if array.dtype.kind == "u" and (array > _MOST).any():
        raise InputError(f"{name}: {array.max()}, expected at most {_MOST}")
    return array.astype(np.int64)


def _of_configurations(values, name, configuration, count):
    """The mean of each configuration over its rows that are not NaN; NaN where there are none."""
    if values is None:
        return np.full(count, np.nan)
    values = _numbers(values, name)
    if values.ndim == 0:
        values = np.full(len(configuration), values)
    if values.shape != configuration.shape:
        raise InputError(f"{name}: an array of shape {values.shape}, expected {configuration.shape}")
    known = ~np.isnan(values)
    sums = np.bincount(configuration[known], values[known], minlength=count)
    numbers = np.bincount(configuration[known], minlength=count)
    return np.divide(sums, numbers, out=np.full(count, np.nan), where=numbers > 0)


def _is_test(split, configuration, names, place):
    count = len(configuration)
    if split is None:
        return np.zeros(count, dtype=np.int64)
    words = _labels(split, "split", count, "train", place)
    lower = np.array([str(word).lower() for word in words])
    wrong = np.flatnonzero((lower != "train") & (lower != "test"))
    if len(wrong):
        raise InputError(f"{place('split', wrong[0])}: '{words[wrong[0]]}', expected 'train' or 'test'")
    is_test = (lower == "test").astype(np.int64)
    of_configuration = np.zeros(len(names), dtype=np.int64)
    of_configuration[configuration[::-1]] = is_test[::-1]
    mixed = np.flatnonzero(is_test != of_configuration[configuration])
    if len(mixed):
        raise InputError(
            f"{place('split', mixed[0])}: '{words[mixed[0]]}', expected the same in all rows of configuration "
            f"{names[configuration[mixed[0]]]}"
        )
    return is_test


def _flattened(joints, points, by_row):
    """Rows of (N, T, 3) points: joint values and labels of each, without those that were not measured."""
    count, targets = points.shape[:2]
    if joints.ndim != 2 or len(joints) != count:
        raise InputError(f"joints: an array of shape {joints.shape}, expected ({count}, n), a row for each of points")
    _shaped(joints, "joints", joints.shape)
    _refuse_first(points, "points", np.isinf(points) | (np.isnan(points) & ~np.isnan(points).all(axis=2, keepdims=True)))
    names = by_row.pop("targets")
    if names is None:
        names = [chr(ord("A") + i) for i in range(targets)] if targets <= 26 else None
    names = np.asarray(names if names is not None else [str(i + 1) for i in range(targets)])
    if names.shape != (targets,):
        raise InputError(f"targets: an array of shape {names.shape}, expected {(targets,)}, one for each of points[i]")
    measured = ~np.isnan(points).all(axis=2)
    row, target = np.nonzero(measured)
    result = {"targets": names[target]}
    of_targets = set()
    for name, values in by_row.items():
        if values is None or isinstance(values, str) or np.ndim(values) == 0:
            result[name] = values
            continue
        values = np.asarray(values)
        is_of_rows = name == "orientations" and values.ndim == 2  # whose second axis is that of a quaternion
        if values.shape[:2] == (count, targets) and not is_of_rows:
            if name == "sigma":
                _refuse_first(values, name, ~np.isfinite(_numbers(values, name)) & measured)
            result[name] = values[measured]
            of_targets.add(name)
        elif values.shape[:1] == (count,):
            result[name] = values[row]
        else:
            raise InputError(f"{name}: an array of shape {values.shape}, expected ({count},) or ({count}, {targets})")
    return joints[row], points[measured], result, _Places(row, target, of_targets)


def _name_of_link(link):
    return f"link_temperatures['{link}']"


def _by_link(temperatures):
    """{link: values} of a mapping or a structured array."""
    if temperatures is None:
        return {}
    if isinstance(temperatures, np.ndarray) and temperatures.dtype.names:
        _refuse_masked(temperatures, "link_temperatures")
        return {link: temperatures[link] for link in temperatures.dtype.names}
    if not isinstance(temperatures, Mapping):
        kind = type(temperatures).__name__
        raise TypeError(f"link_temperatures: {kind}, expected a mapping of links to numbers or a structured array")
    if not all(isinstance(link, str) for link in temperatures):
        raise TypeError(f"link_temperatures: {list(temperatures)}, expected names of links")
    missing = [link for link, values in temperatures.items() if values is None]
    if missing:
        raise TypeError(f"{_name_of_link(missing[0])}: None, expected numbers")
    return dict(temperatures)


def from_arrays(
    joints,
    points,
    *,
    targets=None,
    configurations=None,
    stations=None,
    sigma=None,
    orientations=None,
    split=None,
    repeats=None,
    order=None,
    temperature=None,
    payload=None,
    link_temperatures=None,
    joint_names=None,
):
    """Measurements from arrays, a row for each measured point.

    joints: (M, n) joint values [rad or m] in the URDF's convention. points: (M, 3) [m] in the frame of the measuring
    device. Or joints (N, n) and points (N, T, 3), T targets in each configuration; those with three NaN were not
    measured.

    targets: names of the points on the tool, one for each row (of (N, T, 3): T names); a single one: "A".
    configurations: labels. Without them rows of equal joint values are one configuration.
    stations: names of the places of the measuring device. sigma: 1 sigma of each coordinate [m], one for all or for
    each row. orientations: (M, 4) unit quaternions w, x, y, z of the targets' frames. split: "train" or "test".
    repeats: rows of a configuration with the same number were measured together; without them they are counted.
    order: integers, the order of driving. temperature [degC], payload [kg]: one for all or for each row, NaN where not
    known; a configuration has their mean. link_temperatures: the same by the URDF link, a mapping {"link_2": (M,) array}
    or a structured array; the others have `temperature`. joint_names: the robot's, unless stated.

    Raises InputError for other shapes and values that are not finite, TypeError for arrays of other types.
    """
    joints = _numbers(joints, "joints")
    points = _numbers(points, "points")
    by_row = {"targets": targets, "configurations": configurations, "stations": stations, "sigma": sigma,
              "orientations": orientations, "split": split, "repeats": repeats, "order": order,
              "temperature": temperature, "payload": payload}  # fmt: skip
    of_links = _by_link(link_temperatures)
    by_row.update({_name_of_link(link): values for link, values in of_links.items()})
    for name, values in by_row.items():
        _refuse_masked(values, name)
        by_row[name] = _plain(values)
    place = _Places()
    if points.ndim == 3:
        if points.shape[2] != 3:
            raise InputError(f"points: an array of shape {points.shape}, expected (N, T, 3) or (M, 3)")
        joints, points, by_row, place = _flattened(joints, points, by_row)
    if points.ndim != 2 or points.shape[1] != 3 or len(points) == 0:
        raise InputError(f"points: an array of shape {points.shape}, expected (M, 3) or (N, T, 3) with at least a row")
    count = len(points)
    points = _shaped(points, "points", (count, 3))
    if joints.ndim != 2 or len(joints) != count or joints.shape[1] == 0:
        raise InputError(f"joints: an array of shape {joints.shape}, expected ({count}, n), a row for each of points")
    joints = _shaped(joints, "joints", joints.shape)
    of_links = {link: by_row.pop(_name_of_link(link)) for link in of_links}
    return _from_rows(joints, points, joint_names, place, link_temperatures=of_links, **by_row)


def _from_rows(joints, points, joint_names, place, *, targets, configurations, stations, sigma, orientations, split,
               repeats, order, temperature, payload, link_temperatures):  # fmt: skip
    count, width = joints.shape
    names, configuration, first = _configurations(joints, configurations, place)
    target_names, target = _numbered(_labels(targets, "targets", count, "A"))
    station_names, station = _numbered(_labels(stations, "stations", count, "W", place))
    repeat = _integers(repeats, "repeats", count, place)
    if repeat is None:
        repeat = _repeats(configuration, target, len(target_names))
    else:
        wrong = np.flatnonzero((repeat < 0) | (repeat > _MOST_REPEATS))
        if len(wrong):
            raise InputError(f"{place('repeats', wrong[0])}: {repeat[wrong[0]]}, expected 0 to {_MOST_REPEATS}")
        _refuse_twice(np.column_stack([configuration, target, station, repeat]), place)
    if sigma is not None:
        is_one = np.ndim(sigma) == 0
        sigma = np.full(count, _shaped(sigma, "sigma", ())) if is_one else _shaped(sigma, "sigma", (count,), place)
        wrong = np.flatnonzero((sigma < 0.0) | ((sigma > 0.0) & (sigma < _SMALLEST_SIGMA)))
        if len(wrong):
            raise InputError(
                f"{place('sigma', wrong[0])}: {sigma[wrong[0]]}, expected a standard deviation of at least "
                f"{_SMALLEST_SIGMA} m"
            )
    if orientations is not None:
        orientations = _shaped(orientations, "orientations", (count, 4), place)
        wrong = np.flatnonzero(abs(np.linalg.norm(orientations, axis=1) - 1.0) > 1e-3)
        if len(wrong):
            raise InputError(
                f"{place('orientations', wrong[0])}: its norm is not 1, expected a unit quaternion w, x, y, z"
            )
    joint_names = [] if joint_names is None else list(joint_names)
    if not all(isinstance(name, str) for name in joint_names):
        raise TypeError(f"joint_names: {joint_names}, expected texts")
    if joint_names and len(joint_names) != width:
        raise InputError(f"joint_names: {len(joint_names)} names, expected {width}, one for each column of joints")
    twice = [name for i, name in enumerate(joint_names) if name in joint_names[:i]]
    if twice:
        raise InputError(f"joint_names: '{twice[0]}' is there twice, expected names that differ")
    driven = _integers(order, "order", count, place)
    nothing = np.empty(0)
    around = [_of_configurations(values, name, configuration, len(names))
              for name, values in (("temperature", temperature), ("payload", payload))]  # fmt: skip
    of_links = [_of_configurations(values, _name_of_link(link), configuration, len(names))
                for link, values in link_temperatures.items()]  # fmt: skip
    rows = {
        "points": points,
        "orientations": nothing if orientations is None else orientations,
        "sigma": nothing if sigma is None else sigma,
        "order": nothing.astype(np.int64) if driven is None else driven,
        "configuration": configuration,
        "target": target,
        "station": station,
        "repeat": repeat,
        "is_test": _is_test(split, configuration, names, place),
        "circumstances": nothing if temperature is None and payload is None else np.column_stack(around),
        "link_temperatures": np.column_stack(of_links) if of_links else nothing,
    }
    stated = {"links": list(link_temperatures), "joints": joint_names, "configurations": names, "targets": target_names, "stations": station_names}
    return _native._from_rows(joints[first], width, rows, stated)


def from_pandas(frame, joints, points=("x", "y", "z"), **columns):
    """Measurements from a data frame, a row for each measured point.

    joints, points: names of its columns, [rad or m] and [m]. Keywords as in from_arrays name a column
    (targets="target") or are arrays; orientations names four. Without them the columns target, configuration,
    station, sigma, split, repeat, temperature, temperature_<link> and payload are used if there are any. Needs no
    pandas beside that of the frame.
    """
    joints, points = list(joints), list(points)
    present = list(frame.columns)
    missing = [name for name in [*joints, *points] if name not in present]
    if missing:
        raise InputError(f"column '{missing[0]}' is not in the data frame, expected one of {present}")

    def column_of(name):
        if present.count(name) > 1:
            raise InputError(f"column '{name}' is there {present.count(name)} times, expected it once")
        return _plain(frame[name])

    def columns_of(names, keyword):
        return np.column_stack([_numbers(column_of(name), f"{keyword}, column '{name}'") for name in names])

    usual = {"targets": "target", "configurations": "configuration", "stations": "station", "sigma": "sigma",
             "split": "split", "repeats": "repeat", "temperature": "temperature",
             "payload": "payload"}  # fmt: skip
    for keyword, column in usual.items():
        if column in frame.columns:
            columns.setdefault(keyword, column)
    prefix = "temperature_"
    of_links = {name[len(prefix) :]: name for name in frame.columns
                if isinstance(name, str) and name.startswith(prefix) and len(name) > len(prefix)}  # fmt: skip
    if of_links and not set(of_links.values()) & {*joints, *points}:
        columns.setdefault("link_temperatures", of_links)
    if isinstance(columns.get("link_temperatures"), Mapping):
        columns["link_temperatures"] = {
            link: column_of(values) if isinstance(values, str) and values in frame.columns else values
            for link, values in columns["link_temperatures"].items()
        }
    given = {}
    for keyword, value in columns.items():
        if isinstance(value, str) and value in frame.columns:
            given[keyword] = column_of(value)
        elif keyword == "orientations" and value is not None and all(isinstance(name, str) for name in value):
            given[keyword] = columns_of(value, "orientations")
        else:
            given[keyword] = value
    given.setdefault("joint_names", joints)
    return from_arrays(columns_of(joints, "joints"), columns_of(points, "points"), **given)
