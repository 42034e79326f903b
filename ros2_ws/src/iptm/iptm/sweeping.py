"""Trips for every combination of values."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from concurrent.futures import Executor
from dataclasses import dataclass
from itertools import product
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from iptm.call_cache import cached_calls
from iptm.driving import simulate
from iptm.run import Run, figure_title
from iptm_core.errors import ParameterError, ScenarioError

if TYPE_CHECKING:
    import pandas as pd


@dataclass(frozen=True, eq=False)
class Sweep:
    """Runs of a sweep.

    Attributes:
        values: of the varied settings, by name, for each run.
        runs: in the same order.
    """

    values: tuple[Mapping[str, Any], ...]
    runs: tuple[Run, ...]

    @property
    def varied(self) -> pd.DataFrame:
        """Values of the varied settings, one row per run."""
        import pandas as pd  # noqa: PLC0415  half a second, and a sweep may be left to its runs

        return pd.DataFrame(list(self.values))

    def savings(self, **base: Any) -> pd.DataFrame:
        """What each run saved against the one with other values, such as ``strategy="reference"``.

        Args:
            base: values of the run to compare with, by name; all others stay as in each run.

        Returns:
            A row per run: percentages, NaN where they cannot be judged, and the judgement of the ageing.

        Raises:
            ScenarioError: a name was not varied, or no run has such values.
        """
        import pandas as pd  # noqa: PLC0415  see above

        rows = []
        for own, run in zip(self.values, self.runs, strict=True):
            wanted = {**own, **base}
            same = [other for other, values in enumerate(self.values) if values == wanted]
            if not same:
                raise ScenarioError(
                    f"savings: no run has {wanted}; allowed: values of {', '.join(own)}"
                )
            found = run.saving(self.runs[same[0]])
            titled = {figure_title(key): value for key, value in found.values.items()}
            rows.append({**titled, "judgement": str(found.aging.judgement)})
        return pd.DataFrame(rows, index=pd.MultiIndex.from_frame(self.varied))

    @property
    def table(self) -> pd.DataFrame:
        """Figures, a row per run and a column per figure; varied settings form the index.

        Where a run has problems, such as an early end, a column in front states them.
        """
        import pandas as pd  # noqa: PLC0415  see above

        rows = pd.DataFrame([run.summary for run in self.runs])
        if any(run.problems for run in self.runs):
            rows.insert(0, "problems", ["; ".join(run.problems) for run in self.runs])
        rows.index = pd.MultiIndex.from_frame(self.varied)
        return rows


def sweep(
    *,
    workers: int | None = 1,
    executor: Executor | None = None,
    cache: str | Path | None = None,
    **arguments: Any,
) -> Sweep:
    """Drive every combination of values in lists, tuples, ranges and arrays, the last one varying fastest.

    Args:
        workers: number of processes; 1 for this one, None for one per core.
        executor: drives instead, such as ``client.get_executor()`` of `dask.distributed`.
        cache: folder of finished runs, which are not driven again, see `cached_calls`.
        arguments: as for `simulate`; a list, a range or an array of one dimension, also as a value in
            ``overrides`` or in a vehicle given as a mapping, stands for one run per entry.

    Raises:
        IptmError: as for `simulate`, or the list is missing or empty, or a run failed.
    """
    axes = dict(_axes(arguments))
    if not axes or not all(axes.values()):
        raise ParameterError(
            f"sweep: lists are {[key or name for name, key in axes]}; allowed: one or more, none empty"
        )
    rows: list[dict[str, Any]] = []
    calls: list[dict[str, Any]] = []
    for values in product(*axes.values()):
        chosen = dict(zip(axes, values, strict=True))
        single: dict[str, Any] = {**arguments}
        for (name, key), value in chosen.items():
            single[name] = value if key is None else {**single[name], key: value}
        calls.append(single)
        rows.append({key or name: _label(value) for (name, key), value in chosen.items()})
    runs: dict[int, Run] = {}
    for outcome in cached_calls(simulate, calls, workers=workers, executor=executor, cache=cache):
        if outcome.failure:
            raise ScenarioError(f"sweep: {rows[outcome.index]}: {outcome.failure}")
        runs[outcome.index] = outcome.value
    return Sweep(tuple(rows), tuple(runs[index] for index in range(len(calls))))


def _axes(arguments: Mapping[str, Any]) -> Iterator[tuple[tuple[str, str | None], list[Any]]]:
    for name, value in arguments.items():
        if _is_series(value):
            yield (name, None), _listed(value)
        elif isinstance(value, Mapping):
            for key, entry in value.items():
                if _is_series(entry):
                    yield (name, key), _listed(entry)


def _is_series(value: Any) -> bool:
    # A tuple of arrays is a drive.
    plain = isinstance(value, tuple) and all(isinstance(each, str | int | float) for each in value)
    return (
        plain
        or isinstance(value, list | range)
        or (isinstance(value, np.ndarray) and value.ndim == 1)
    )


def _listed(values: Any) -> list[Any]:
    return values.tolist() if isinstance(values, np.ndarray) else list(values)


def _label(value: Any) -> Any:
    """Return what stands for a value in the index of a table."""
    if isinstance(value, (str, int, float)):
        return value
    return getattr(value, "name", None) or type(value).__name__
