"""Rules for copying and pickling stateful objects: an object is copied with everything that it holds, or not at all."""

from copy import deepcopy
from typing import ClassVar, NoReturn, Self


class CopiedWhole:
    """A stateful object whose copy shares nothing with the original. After a shallow copy, original and copy would
    change the same arrays, but each would count its own steps."""

    def __copy__(self) -> Self:
        return deepcopy(self)


class NeverCopied:
    """An object with resources of this process, which cannot be copied: a child process, a library's memory, a socket.

    Attributes:
        INSTEAD: end of the error message, which states what to do instead of copying.
    """

    INSTEAD: ClassVar[str]

    def __reduce_ex__(self, protocol: object) -> NoReturn:
        raise TypeError(f"{type(self).__name__} can neither be copied nor pickled: {self.INSTEAD}")
