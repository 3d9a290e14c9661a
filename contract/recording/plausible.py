"""The checks for numbers that a pressure sensor, a force balance or a logger hardly ever gives. Each report states the
likely cause and a remedy. No check stops training, because the body may be unusual."""

import itertools
from collections.abc import Iterator, Sequence
from typing import Final

import numpy as np

from contract.arrays import Array, Mask, runs
from contract.recording.dataset import Dataset, Episode

_HIGHEST: Final = 1.1
"""Highest plausible mean Cp: 1, the stagnation pressure of a steady stream, plus 0.1 for errors of p_inf and U_inf."""
_LOWEST: Final = -5.0
"""Lowest plausible mean Cp, at a leading edge or a rotating cylinder. Only means below -5.5 are reported."""
_SWINGS: Final = (-6.0, 1.25)
"""Bounds of Cp; at most one row in twenty may be beyond either. Noise of 15 % at a stagnation point stays within."""
_MOMENT: Final = 20.0
"""Largest plausible |Cp| in a single row. Conical vortices on roofs reach 15 for a short time."""
_FORCE: Final = 5.0
"""Largest plausible mean Cd, and largest plausible standard deviation of Cl. A plate across the stream has a Cd of 2,
and of 4 in a narrow tunnel; only creeping flow has a larger Cd. Cylinders that oscillate with their wake reach 3."""
_DRAG: Final = 0.02
"""Smallest plausible mean Cd, based on the width across the stream; slender sections have 0.04."""
_FLAT: Final = 0.01
"""Smallest plausible root mean square of all Cp. It is 0.1 at the base of a slender body."""
_SCALE: Final = 3.0
"""Largest plausible ratio of mean Cd or rms Cp between files. Control rarely removes more than half of the drag."""
_SCALE_OF_LIFT: Final = 10.0
"""Largest plausible factor between the ratios std Cl / std Cp of two files. Cl and Cp vary together with the wake."""
_FAR: Final = (4.0, 10.0)
"""Smallest distances at which a repeated extreme value, such as -99, 99.99 or -9.99, is taken for a missing reading:
from the nearest other value, and from the median of the other values, in interquartile ranges of these values."""
_STILL: Final = 20
"""Number of rows after which a constant sensor may be stuck if the other sensors change: most of a shedding cycle."""
_STEPS: Final = 4.0
"""A constant sensor is stuck if, as the other sensors vary, it should have changed by more than so many resolutions."""
_FINEST: Final = 2.0**-12
"""Smallest resolution that is assumed for a series: twice the quantum with which a data set stores Cp."""
_CLIPPED: Final = 0.03
"""Share of rows at a sensor's extreme value, in runs of three rows or more, above which the sensor may be saturated."""
_SHOWN: Final = 3
"""Number of episodes or sensors that a line lists before it counts the rest. Up to six sensors are all listed."""
_CELLS: Final = 256
"""Cells per standard deviation of a column. Values in one cell count as equal, values within 16 cells as similar."""
_ALIKE: Final = (10, 0.25)
"""Two files are reported if at least this number of rows, and half of the rows from the first of them to the last, are
equal in the same order, or if more than this share of the shorter file's rows are equal in any order."""
_Note = tuple[str, str]
"""A note: the observation in an episode, and its cause with the remedy."""


def dominant_frequency(values: Array, period: float) -> float | None:
    """Return the frequency of the largest peak in a series' spectrum with a Hann window. The resolution is an eighth of
    1 / duration. Return None for fewer than 16 samples or a constant series."""
    fluctuation = values - values.mean()
    if len(values) < 16 or not fluctuation.any():
        return None
    padded = 8 * len(values)
    spectrum = np.abs(np.fft.rfft(fluctuation * np.hanning(len(values)), padded))
    # Lower frequencies have less than one and a half periods in the record, so their peaks count as drift.
    return float((12 + spectrum[12:].argmax()) / (padded * period))


def share_near(values: Array, period: float, frequency: float, width: float) -> float:
    """Return the share of a series' fluctuation power in a band around a frequency, with a Hann window. The band
    extends to either side by `width` times the frequency, and at least by the two bins of a Hann window's peak."""
    power = np.abs(np.fft.rfft((values - values.mean()) * np.hanning(len(values)))) ** 2
    bins = np.fft.rfftfreq(len(values), period)
    near = np.abs(bins - frequency) <= max(width * frequency, 2.0 / (len(values) * period))
    return float(power[near].sum() / power.sum())


def implausible(dataset: Dataset) -> Iterator[str]:
    """Yield a line per cause, with the episodes and values that show the cause, then lines on pairs of files."""
    names = (*dataset.layout.names, "Cd", "Cl")
    tables = [np.column_stack([item.series[name] for name in ("Cp", "Cd", "Cl")]) for item in dataset.episodes]
    missing = [_stand_for_none(table) for table in tables]
    sound = [table[~gaps.any(axis=1)] if gaps.any() else table for table, gaps in zip(tables, missing, strict=True)]
    spread, finest = _usual(sound, len(names))
    found: dict[str, list[str]] = {}
    for episode, table, gaps, kept in zip(dataset.episodes, tables, missing, sound, strict=True):
        notes = [*_missing(names, table, gaps)]
        if len(kept) > 1:
            notes += _forces(episode, kept, symmetric=dataset.layout.mirror is not None)
            notes += _pressures(episode, dataset.layout.names, kept[:, :-2])
            notes += _readings(names, table, np.any(gaps, axis=0), spread, finest, episode.series["action"])
        for what, cause in notes:
            found.setdefault(cause, []).append(f"episode {episode.name}: {what}")
    for cause, whats in found.items():
        more = f" (and {len(whats) - _SHOWN} more)" if len(whats) > _SHOWN else ""
        yield f"{'; '.join(whats[:_SHOWN])}{more}: {cause}"
    yield from _scales(dataset.episodes, sound)
    yield from _copies(dataset.episodes, tables, spread)


def longest_run(quiet: Mask) -> tuple[int, int]:
    """Return start and length of the longest run of True values; (0, 0) if no value is True."""
    start, end = max(runs(quiet), key=lambda run: run[1] - run[0], default=(0, 0))
    return start, end - start


def _usual(tables: Sequence[Array], columns: int) -> tuple[Array, Array]:
    """Return the standard deviation and the resolution of every column, over all tables."""
    count, total, squares, finest = 0, np.zeros(columns), np.zeros(columns), np.full(columns, 1e3)
    for table in tables:
        count, total = count + len(table), total + table.sum(axis=0)
        squares = squares + np.square(table).sum(axis=0)
        steps = np.abs(np.diff(table, axis=0))
        finest = np.minimum(finest, np.where(steps > 0, steps, np.inf).min(axis=0, initial=np.inf))
    variance = squares / max(count, 1) - np.square(total / max(count, 1))
    # The variance of a constant column consists of rounding errors only.
    return np.sqrt(np.where(variance > 1e-12 * squares / max(count, 1), variance, 0.0)), finest.clip(_FINEST)


def _stand_for_none(table: Array) -> Mask:
    """Return a mask of values that mark missing readings: far from all others, and repeated or beyond `_MOMENT`."""
    found = np.zeros(table.shape, dtype=np.bool_)
    for extreme, sign in ((table.max(axis=0), 1.0), (table.min(axis=0), -1.0)):
        here = table == extreme
        next_one = (sign * np.where(here, -sign * np.inf, table)).max(axis=0)
        for k in np.flatnonzero((sign * extreme - next_one > _FAR[0]) & np.isfinite(next_one)):
            low, half, high = np.quantile(table[~here[:, k], k], (0.25, 0.5, 0.75))
            again = here[:, k].sum() > 1 or abs(extreme[k]) > _MOMENT
            if again and abs(extreme[k] - half) > _FAR[1] * (high - low):
                found[:, k] |= here[:, k]
    return found


def _missing(names: Sequence[str], table: Array, gaps: Mask) -> Iterator[_Note]:
    for value in np.unique(table[gaps]):
        here = gaps & (table == value)
        start, run = longest_run(here.any(axis=1))
        rows = int(here.any(axis=1).sum())
        times = f"in {rows} rows, first at step {start}," if rows > 1 else f"at step {start}"
        times = f"{run} times in a row from step {start}" if run > 1 else times
        where = f"{value:.6g} occurs {times} in {_listed(names, here.any(axis=0))}, far from all other values"
        yield where, "a logger may write this value for a missing reading; fill the gap, or cut the file in two there"


def _forces(episode: Episode, table: Array, *, symmetric: bool) -> Iterator[_Note]:
    drag, lift, action = table[:, -2], table[:, -1], episode.series["action"]
    mean, pushed = float(drag.mean()), abs(action.mean()) > 0.5 * np.sqrt(np.square(action).mean())
    in_newtons = "for forces in N, import with rho U_inf^2 / 2 times W and the span as in --reference {}=40N"
    upside_down = f"; {in_newtons.format('Cd').replace('=', '=-')}" if mean < -_FORCE else ""
    if abs(lift.mean()) > abs(mean) and not pushed and (symmetric or drag.std() > abs(mean)):
        cause = "the mean lift of a body is small compared with its drag, so the two seem exchanged; import with --map"
        yield f"mean Cl is {lift.mean():.3g} and mean Cd {mean:.3g}", f"{cause} Cd=Cl --map Cl=Cd"
    elif mean <= 0.0:
        cause = "a body in a stream has drag above 0, and control would raise the drag; import with --reference Cd=-1"
        yield f"mean Cd is {mean:.3g}", f"{cause} if the file has the other sign{upside_down}"
    elif mean < _DRAG:
        yield f"mean Cd is {mean:.3g}", f"a body has {_DRAG:g} or more, based on its width; {in_newtons.format('Cd')}"
    for name, what, size in (("Cd", "mean Cd", mean), ("Cl", "the deviation of Cl", float(lift.std()))):
        if size > _FORCE:
            yield f"{what} is {size:.3g}", f"no body in a stream reaches {_FORCE:g}; {in_newtons.format(name)}"


def _pressures(episode: Episode, names: Sequence[str], pressure: Array) -> Iterator[_Note]:
    mean, (low, high) = pressure.mean(axis=0), np.quantile(pressure, (0.05, 0.95), axis=0)
    beyond = (mean > _HIGHEST) | (mean < 1.1 * _LOWEST) | (low < _SWINGS[0]) | (high > _SWINGS[1])
    deviation, swing = pressure.std(axis=0), np.ptp(pressure, axis=0)
    beyond &= (swing > 0) | (swing.max() == 0)  # a stuck sensor is reported as stuck
    if beyond.any():
        worst = int(np.argmax(np.where(beyond, np.abs(mean) + high - low, -1.0)))
        least, most = pressure[:, worst].min(), pressure[:, worst].max()
        remedy = f"for a sensor in another unit, give the number that means 1 as in --reference {names[worst]}=375Pa"
        if 2 * beyond.sum() > len(names):
            remedy = "for pressures in Pa against p_inf, import with rho U_inf^2 / 2 as in --reference Cp=240Pa"
        yield (
            f"Cp of {_listed(names, beyond)} is {mean[worst]:.3g} in the mean, from {least:.3g} to {most:.3g}",
            f"mean Cp on a wall is {_LOWEST:g} to {_HIGHEST:g}; {remedy}",
        )
    size, rms = float(np.sqrt(np.square(pressure).mean())), np.sqrt(np.square(pressure).mean(axis=0))
    divisor = _divisor(episode)
    least, most = pressure.min() * divisor, pressure.max() * divisor
    already = divisor > 1.0 and size < 10.0 * _FLAT and least >= _LOWEST and most <= _SWINGS[1]
    if size < _FLAT or already:
        before = f", because values of {least:.3g} to {most:.3g} were divided by {divisor:g}" if already else ""
        cause = "dimensionless numbers need no --reference Cp"
        yield f"all Cp are within {np.abs(pressure).max():.3g}{before}", cause
    weak = (rms < 0.01 * np.median(rms)) & (deviation < 0.01 * np.median(deviation)) & (swing > 0)
    if weak.any():
        yield (
            f"Cp of {_listed(names, weak)} is less than a hundredth of that of the other sensors",
            f"its unit differs (--reference {names[int(weak.argmax())]}=NUMBER), or the sensor is not connected",
        )


def _listed(names: Sequence[str], which: Mask) -> str:
    chosen = [name for name, meant in zip(names, which, strict=True) if meant]
    if len(chosen) <= 2 * _SHOWN:
        return " and ".join([*filter(None, [", ".join(chosen[:-1])]), chosen[-1]])
    return f"{', '.join(chosen[:_SHOWN])} and {len(chosen) - _SHOWN} more"


def _divisor(episode: Episode) -> float:
    """Return the number by which the import divided the pressures in the file."""
    references = episode.provenance.get("references")
    found = references.get("Cp") if isinstance(references, dict) else None
    number = found[0] if isinstance(found, list) and found else None
    return float(number) if isinstance(number, int | float) else 1.0


def _readings(
    names: Sequence[str], table: Array, told: Mask, spread: Array, finest: Array, action: Array
) -> Iterator[_Note]:
    """Report stuck or saturated sensors, copies of another sensor, and repeated rows. Columns in `told` are skipped."""
    rows = len(table)
    changes = np.flatnonzero((np.diff(table, axis=0) != 0).any(axis=1))
    gaps = np.diff(changes)
    times = int(np.median(gaps)) if len(gaps) > 8 else 1
    jumps = np.abs(np.diff(table, axis=0))[changes].max(axis=1, initial=0.0) if times > 1 else np.zeros(1)
    if times > 1 and np.mean(gaps == times) > 0.9 and np.median(jumps) > 0.05 * spread.max():
        yield (
            f"every row occurs {times} times, {rows - 1 - len(changes)} of {rows} equal the row before",
            f"keep one of {times}, and give flow.control_period and t of the remaining rows",
        )
        return
    still, swing = np.diff(table, axis=0) == 0, np.ptp(table, axis=0)
    share = still.mean(axis=0)
    copies: dict[bytes, list[str]] = {}
    for k, name in enumerate(names):
        start, run = longest_run(still[:, k])
        long = run >= _STILL
        span = slice(start, start + run + 1) if long else slice(None)
        held = long or (share[k] > 0.5 and np.median(np.delete(share, k)) < 0.2)
        if told[k]:
            continue
        if held and finest[k] * _STEPS < spread[k] * _activity(table[span], k, spread, action[span], action):
            where = f"in {share[k]:.0%} of the rows"
            where = f"at {table[start, k]:.4g} for {run + 1} of {rows} rows from step {start}" if long else where
            cause = "leave out a sensor that is stuck, or cut the file there"
            yield f"{name} is constant {where}, while the other sensors change", cause
            continue
        for word, extreme in (("largest", table[:, k].max()), ("smallest", table[:, k].min())):
            here = table[:, k] == extreme
            stretches = runs(here)
            clipped = sum(end - start for start, end in stretches if end - start >= 3)
            # `usual` is the share of rows in which a sine is within four resolution steps of its largest value. This
            # share is twice the share within one step.
            usual = 2.0 * np.sqrt(4.0 * finest[k] / max(swing[k], finest[k])) / np.pi
            if clipped <= max(_CLIPPED, usual) * rows or len(stretches) < 2:
                continue
            # In a steady wake all sensors are constant, so other sensors or the jets must vary in these rows.
            if finest[k] * _STEPS < spread[k] * _activity(table[here], k, spread, action[here], action):
                yield (
                    f"{name} is at its {word} value, {extreme:.4g}, in {clipped} of {rows} rows",
                    "the sensor is saturated: widen its range, or leave it out",
                )
        if swing[k] > 10.0 * finest[k]:
            copies.setdefault(table[:, k].tobytes(), []).append(name)
    for same in copies.values():
        if len(same) > 1:
            yield f"{' and '.join(same)} are equal in every row", "a column was written twice: leave out one of them"


def _activity(table: Array, k: int, spread: Array, action: Array, all_actions: Array) -> float:
    """Return the variation of the other sensors or of the jets in these rows, relative to the variation in all rows."""
    others = np.delete(np.arange(len(spread)), k)
    others = others[spread[others] > 0]
    moved = float(np.median(table[:, others].std(axis=0) / spread[others])) if others.size else 0.0
    return max(moved, float(action.std() / max(all_actions.std(), 1e-12)))


def _scales(episodes: Sequence[Episode], tables: Sequence[Array]) -> Iterator[str]:
    if len([table for table in tables if len(table) > 1]) < len(tables):
        return
    deviation = np.array([np.sqrt(table[:, :-2].var(axis=0).mean()) for table in tables])
    lively = deviation >= deviation.max() / _SCALE
    lift = np.array([table[:, -1].std() for table in tables]) / np.where(lively & (deviation > 0), deviation, np.inf)
    for what, sizes, most, least in (
        ("rms Cp", np.array([np.median(np.sqrt(np.square(one[:, :-2]).mean(axis=0))) for one in tables]), _SCALE, 0.0),
        ("mean Cd", np.array([abs(table[:, -2].mean()) for table in tables]), _SCALE, _DRAG),
        ("the deviation of Cl divided by that of Cp", lift, _SCALE_OF_LIFT, 0.0),
    ):
        low, high = int(np.argmin(np.where(sizes > 0, sizes, np.inf))), int(sizes.argmax())
        if sizes[low] > least and sizes[high] > most * sizes[low]:
            yield (
                f"{what} is {sizes[high]:.3g} in {episodes[high].name} and {sizes[low]:.3g} in {episodes[low].name}, "
                f"a factor of {sizes[high] / sizes[low]:.3g}: files of one body have similar values, so one file has "
                f"another unit or scale; convert this file, because --reference holds for all files"
            )


def _copies(episodes: Sequence[Episode], tables: Sequence[Array], spread: Array) -> Iterator[str]:
    """Report files that contain rows of another file. A test on rows that were used for training is invalid."""
    chosen = [*np.unique(np.linspace(0, len(spread) - 3, 4).astype(int)), -2, -1]
    cells = np.maximum(2 * _FINEST, spread[chosen] / _CELLS)
    rows = np.concatenate([np.round(table[:, chosen] / cells) for table in tables]).astype(np.int64)
    owner = np.repeat(np.arange(len(tables)), [len(table) for table in tables])
    step = np.concatenate([np.arange(len(table)) for table in tables])
    # A periodic wake also repeats itself within a file, so only rows that occur once in their file count.
    _, back, counts = np.unique(np.column_stack([owner, rows >> 4]), axis=0, return_inverse=True, return_counts=True)
    alone = counts[back.ravel()] == 1
    _, kind = np.unique(rows[alone], axis=0, return_inverse=True)
    order = np.argsort(kind.ravel(), kind="stable")
    kind, file, at = kind.ravel()[order], owner[alone][order], step[alone][order]
    shared: dict[tuple[int, int], list[tuple[int, int]]] = {}
    for ahead in range(1, len(tables)):
        for k in np.flatnonzero(kind[ahead:] == kind[:-ahead]):
            shared.setdefault((int(file[k]), int(file[k + ahead])), []).append((int(at[k]), int(at[k + ahead])))
    copies: dict[tuple[int, int], str] = {}
    for (a, b), found in shared.items():
        pairs = np.array(found)
        offsets, times = np.unique(pairs[:, 0] - pairs[:, 1], return_counts=True)
        in_order = pairs[pairs[:, 0] - pairs[:, 1] == offsets[times.argmax()], 1]
        between = (owner == b) & alone & (step >= in_order.min()) & (step <= in_order.max())
        few, ahead = min(len(tables[a]), len(tables[b])), int(offsets[times.argmax()])
        # Rounding may move equal values into different cells, so the rows are compared at the offset of the matches.
        one, other = tables[a][max(ahead, 0) :], tables[b][max(-ahead, 0) :]
        size = min(len(one), len(other))
        same = np.abs(one[:size] - other[:size]).max(axis=1) <= 4 * _FINEST
        count = max(len(pairs), int((same & alone[owner == b][max(-ahead, 0) :][:size]).sum()))
        if count > _ALIKE[1] * few or len(in_order) >= max(_ALIKE[0], 0.5 * between.sum()):
            copies[a, b] = f"has {count} rows or more of"
    sources = [(item.provenance.get("source_sha256"), item.provenance.get("source")) for item in episodes]
    for a, b in itertools.combinations(range(len(tables)), 2):
        one, other = tables[a], tables[b]
        whole = one.shape == other.shape and all(
            np.abs(one[part] - other[part]).max() <= 4 * _FINEST for part in (slice(1), slice(None))
        )
        (digest, name), (other_digest, other_name) = sources[a], sources[b]
        if whole or (digest is not None and digest == other_digest and name != other_name):
            copies[a, b] = "is a copy of"
    for (a, b), how in sorted(copies.items()):
        later, earlier = (f"{episodes[k].name} ({episodes[k].role})" for k in (b, a))
        yield (
            f"episode {later} {how} {earlier}: a model must be tested on rows to which it was not fitted, and no row "
            f"may count twice; leave one episode out, or remove the common rows"
        )
