"""Access to the groups of an open result file, which opens each dataset and reads single values only once."""

from typing import Any


class Columns:
    """The datasets of a group of a result file, keyed by name.

    A dataset with one value per image is returned as an array, and read when it is needed for the first time.
    Other datasets stay in the file; each of their rows is read when it is used.
    """

    def __init__(self, group: Any) -> None:
        self._group, self._known = group, dict[str, Any]()

    def __contains__(self, name: str) -> bool:
        return name in self._known or name in self._group

    def __getitem__(self, name: str) -> Any:
        if name not in self._known:
            self._known[name] = self._opened(name)
        return self._known[name]

    def _opened(self, name: str) -> Any:
        import h5py

        dataset = self._group[name]
        if isinstance(dataset, h5py.Group):
            return Columns(dataset)
        if dataset.ndim != 1:
            return dataset
        return dataset.asstr()[:] if h5py.check_string_dtype(dataset.dtype) else dataset[:]
