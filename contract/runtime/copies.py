"""How objects whose parts move together are copied and pickled: whole, or not at all."""

from copy import deepcopy
from typing import ClassVar, NoReturn, Self


class CopiedWhole:
    """An object with a state of its own: `copy.copy` gives what `copy.deepcopy` gives, which shares nothing with it.

    A copy that shared the arrays alone would be moved by the other one, and count its steps by itself.
    """

    def __copy__(self) -> Self:
        return deepcopy(self)


class NeverCopied:
    """An object that holds what is this process's alone: a child, a library's memory, a socket.

    Attributes:
        INSTEAD: what to do in place of a copy, for the error.
    """

    INSTEAD: ClassVar[str]

    def __reduce_ex__(self, protocol: object) -> NoReturn:
        raise TypeError(f"{type(self).__name__} can neither be copied nor pickled: {self.INSTEAD}")
