# SPDX-FileCopyrightText: 2026 The soilvdb authors
# SPDX-License-Identifier: Apache-2.0
"""Values of machines by their number or name."""

from typing import Iterator, List, Sequence, Tuple, Union


class ByMachine(Sequence[Tuple[float, float]]):
    """(mean, sigma) of each machine, by number or name."""

    def __init__(self, names: List[str], values: List[Tuple[float, float]]) -> None:
        self._names = names
        self._values = values

    def __getitem__(self, machine: Union[int, str]) -> Tuple[float, float]:  # type: ignore[override]
        if isinstance(machine, str):
            if machine not in self._names:
                raise KeyError(f"there is no machine '{machine}'; there are: {', '.join(self._names)}")
            return self._values[self._names.index(machine)]
        return self._values[machine]

    def __len__(self) -> int:
        return len(self._values)

    def __iter__(self) -> Iterator[Tuple[float, float]]:
        return iter(self._values)

    def __repr__(self) -> str:
        pairs = (f"'{n}': ({m:.4g}, {s:.2g})" for n, (m, s) in zip(self._names, self._values))
        return "{" + ", ".join(pairs) + "}"
