"""What the filter knows as a message, and a message's pose as what it knows. Pure."""

import math
from collections.abc import Sequence

from robo_messages import (
    Header,
    Odometry,
    Point,
    Pose,
    PoseWithCovariance,
    Twist,
    TwistWithCovariance,
    Vector3,
)
from robo_services.ekf import FURTHEST, LEAST_VARIANCE, QUANTITIES, VX, VY, VYAW, YAW, Estimate, Unusable, X, Y
from robo_services.ekf_parameters import INITIAL
from robo_services.factors import Factors, NotPositive
from robo_services.planar import quaternion_from_yaw, yaw_from_quaternion
from robo_services.uncertainty import NOT_MEASURED

_PLANE = (0, 1, 5)


def odometry_of(known: Estimate, header: Header, base_frame: str) -> Odometry:
    """An estimate as a message.

    Args:
        known: what is known.
        header: its stamp, and the frame of the pose.
        base_frame: the frame of the velocities.
    """
    mean, covariance = known.mean, known.covariance()
    pose = Pose(Point(mean[X], mean[Y]), quaternion_from_yaw(mean[YAW]))
    twist = Twist(Vector3(mean[VX], mean[VY]), Vector3(z=mean[VYAW]))
    return Odometry(
        header,
        base_frame,
        PoseWithCovariance(pose, _six_by_six(covariance, (X, Y, YAW))),
        TwistWithCovariance(twist, _six_by_six(covariance, (VX, VY, VYAW))),
    )


def placed(known: Estimate, said: PoseWithCovariance, unsure: Sequence[float]) -> Estimate:
    """What is known of a base that was put somewhere: how it moves is not known any more.

    Args:
        known: what was known; its time stays.
        said: where it is; a variance of 0 means that it is sure.
        unsure: the variances of the velocities and accelerations now.

    Raises:
        Unusable: that is no pose, or no covariance.
    """
    position, numbers = said.pose.position, said.covariance
    yaw = yaw_from_quaternion(said.pose.orientation)
    for name, one in (("x", position.x), ("y", position.y), ("yaw", yaw)):
        if not abs(one) <= FURTHEST:
            raise Unusable(f"{name} = {one:g}")
    n = len(known.mean)
    variances = (*INITIAL[:VX], *unsure)
    matrix = [[max(variances[i], LEAST_VARIANCE) if i == j else 0.0 for j in range(n)] for i in range(n)]
    if any(numbers):
        for i, a in enumerate(_PLANE):
            for j, b in enumerate(_PLANE):
                matrix[i][j] = numbers[6 * a + b]
            if not 0.0 <= matrix[i][i] < math.inf:
                raise Unusable(f"the variance of {QUANTITIES[i]} is {matrix[i][i]:g}")
            matrix[i][i] = max(matrix[i][i], LEAST_VARIANCE)
    try:
        if not all(map(math.isfinite, numbers)):
            raise NotPositive
        factors = Factors.of(matrix)
    except NotPositive:
        raise Unusable("its covariance is none: the errors are more alike than they can be") from None
    return Estimate(known.time, (position.x, position.y, yaw, *(0.0,) * (n - VX)), factors)


def _six_by_six(covariance: list[list[float]], quantities: tuple[int, int, int]) -> tuple[float, ...]:
    """36 numbers, row by row; of what a plane does not have it knows nothing."""
    found = [NOT_MEASURED if i % 7 == 0 else 0.0 for i in range(36)]
    for a, i in zip(_PLANE, quantities, strict=True):
        for b, j in zip(_PLANE, quantities, strict=True):
            found[6 * a + b] = covariance[i][j]
    return tuple(found)
