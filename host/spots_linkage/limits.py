"""Why a linkage has no solution for given angles or positions."""

from enum import IntEnum

from spots.errors import SpotsError


class Limit(IntEnum):
    """Reason why a linkage has no solution for given angles or positions.

    `NONE` (0) means that there is a solution.

    Attributes
    ----------
    sentence : str
        The reason in words.
    """

    sentence: str

    NONE = 0, "there is a solution"
    NOT_FINITE = 1, "a value is not a finite number"
    BEYOND_ARM_1 = 2, "the end point is farther from joint 1 than the two bars of arm 1 reach"
    BEYOND_ARM_2 = 3, "the end point is farther from joint 2 than the two bars of arm 2 reach"
    WITHIN_ARM_1 = 4, "the end point is too close to joint 1 for the unequal bars of arm 1"
    WITHIN_ARM_2 = 5, "the end point is too close to joint 2 for the unequal bars of arm 2"
    AT_JOINT_1 = 6, "the end point is on joint 1, where the angle of joint 1 is undefined"
    AT_JOINT_2 = 7, "the end point is on joint 2, where the angle of joint 2 is undefined"
    OTHER_ASSEMBLY = 8, "only the other assembly of the linkage reaches the end point"
    ELBOWS_APART = 9, "the elbows are farther apart than the outer bars reach"
    ELBOWS_CLOSE = 10, "the elbows are too close together for the unequal outer bars"
    ELBOWS_MEET = 11, "the elbows coincide, so the position of the end point is undefined"
    SINGULAR = 12, "the outer bars are in line, so the angles do not determine the end point"

    def __new__(cls, code: int, sentence: str):
        limit = int.__new__(cls, code)
        limit._value_, limit.sentence = code, sentence
        return limit


class LimitError(SpotsError):
    """Raised if the linkage has no solution for scalar arguments.

    Attributes
    ----------
    limit : Limit
        The reason.
    """

    def __init__(self, limit: Limit, what: str):
        super().__init__(
            f"the linkage has no solution for {what}: {limit.sentence}; choose values inside its "
            "workspace"
        )
        self.limit = limit
