"""A refusal of the ECU's, by its negative response code."""

from can_bridge.uds.services import Nrc


class Refused(Exception):  # noqa: N818  (a negative response is an answer, no error)
    """The request is answered by this code."""

    def __init__(self, code: Nrc, why: str = "") -> None:
        super().__init__(why or code.name)
        self.code = code
