"""The rules for copying and pickling stateful objects: an object is copied with all that it holds, or not at all."""

from copy import deepcopy
from typing import ClassVar, NoReturn, Self


class CopiedWhole:
    """A stateful object whose copy shares nothing with it. Shallow copies would change the same arrays."""

    def __copy__(self) -> Self:
        return deepcopy(self)


class NeverCopied:
    """An object that cannot be copied, because it owns a child process, a library's memory, a socket or the like.
    `INSTEAD` is the end of the error message; it states what to do instead of copying."""

    INSTEAD: ClassVar[str]

    def __reduce_ex__(self, protocol: object) -> NoReturn:
        raise TypeError(f"{type(self).__name__} can neither be copied nor pickled: {self.INSTEAD}")
