"""How sure odometry is of its pose: a covariance that grows by motion, and by nothing else.

Errors are made along the way, each independent of the others, so that their variance grows with the way and with the
turn: twice the way, twice the variance (Chong, Kleeman 1997, "Accurate odometry and error modelling for a mobile
robot"; Siegwart, Nourbakhsh 2004, §5.2.4, for the wheels). An error of the heading moves all that is driven later
(Kelly 2004, "Linearized error propagation in odometry"). What comes out does not depend on how often odometry is
told: it is integrated along the arc.

A 3 × 3 matrix that is multiplied again and again is symmetric and positive but for its rounding. Kept in parts it is
both by construction:

    Σ = | S + h g gᵀ   h g |      S  the position's, if the heading were known, 2 × 2
        |   h gᵀ        h  |      h  the heading's
                                  g  how the position moves with an error of the heading, m/rad

Driving changes only g, for Φ Σ Φᵀ with Φ = (I, (-Δy, Δx)ᵀ; 0, 1) is g + (-Δy, Δx)ᵀ. Each error along the way adds to S,
to h, or to both, and what it adds is a square: neither ever shrinks, and so Σ is positive whatever is driven. Nor does
its determinant, h det S, shrink. Its trace may: whoever drives back the way he came is nearly where his wheels say, for
what his heading did to him on the way out it undoes on the way back.
"""

import math
from typing import Annotated, NamedTuple

import msgspec
from msgspec import Meta

from robo import Unit
from robo_services.kinematics import chord

NOT_MEASURED = 1e6
"""A planar base knows nothing of z, roll and pitch: a large variance, m² or rad²."""

_NODES = tuple((0.5 + place * math.sqrt(0.15), weight / 18) for place, weight in ((-1, 5), (0, 8), (1, 5)))
"""Where Gauss and Legendre look at an arc, from 0 to 1, and what each counts: exact for what is straight."""


class Noise(msgspec.Struct, frozen=True):
    """How odometry errs, as the standard deviation after 1 m or 1 rad; after four times as much it is twice that.

    The four numbers stand for those of Thrun's motion model, α1 to α4 in this order (Thrun, Burgard, Fox 2005, §5.3).
    """

    turn_by_turn: Annotated[
        float, Meta(ge=0, le=10, description="error of the heading after a turn of 1 rad"), Unit("rad")
    ] = 0.05
    turn_by_way: Annotated[float, Meta(ge=0, le=10, description="error of the heading after 1 m"), Unit("rad")] = 0.02
    way_by_way: Annotated[float, Meta(ge=0, le=10, description="error of the way after 1 m"), Unit("m")] = 0.02
    way_by_turn: Annotated[
        float, Meta(ge=0, le=10, description="error of the way after a turn of 1 rad"), Unit("m")
    ] = 0.005

    def variances(self, distance: float, turn: float) -> tuple[float, float]:
        """Of a way of `distance` m and of a turn of `turn` rad, m² and rad²."""
        distance, turn = abs(distance), abs(turn)
        return (
            self.way_by_way**2 * distance + self.way_by_turn**2 * turn,
            self.turn_by_turn**2 * turn + self.turn_by_way**2 * distance,
        )


NOISE = Noise()
"""Of a base that nobody has measured."""


class PoseCovariance(NamedTuple):
    """The covariance of a pose in the plane, in the parts that the module names."""

    xx: float = 1e-6
    """Of S, m². By default a millimetre: who weighs by the inverse of a covariance divides by it."""
    xy: float = 0.0
    """Of S, m²."""
    yy: float = 1e-6
    """Of S, m²."""
    heading: float = 1e-6
    """h, rad²."""
    gx: float = 0.0
    """Of g, m."""
    gy: float = 0.0
    """Likewise."""

    def matrix(self) -> tuple[tuple[float, float, float], ...]:
        """Over x, y, yaw; m², m·rad, rad²."""
        h, gx, gy = self.heading, self.gx, self.gy
        xy = self.xy + h * gx * gy
        return (self.xx + h * gx * gx, xy, h * gx), (xy, self.yy + h * gy * gy, h * gy), (h * gx, h * gy, h)

    def six_by_six(self) -> tuple[float, ...]:
        """As a message has it: 36 numbers, row by row over x, y, z, and the rotations about them."""
        (xx, xy, xt), (_, yy, yt), (_, _, tt) = self.matrix()
        n = NOT_MEASURED
        return (
            *(xx, xy, 0.0, 0.0, 0.0, xt),
            *(xy, yy, 0.0, 0.0, 0.0, yt),
            *(0.0, 0.0, n, 0.0, 0.0, 0.0),
            *(0.0, 0.0, 0.0, n, 0.0, 0.0),
            *(0.0, 0.0, 0.0, 0.0, n, 0.0),
            *(xt, yt, 0.0, 0.0, 0.0, tt),
        )

    def after(self, distance: float, turn: float, yaw: float, noise: Noise) -> "PoseCovariance":
        """What it becomes by driving an arc.

        Args:
            distance: along the arc, m.
            turn: rad.
            yaw: where the robot looked before, rad.
            noise: how it errs.
        """
        if distance == 0.0 and turn == 0.0:
            return self
        x, y = chord(distance, turn, yaw)
        grown = self._replace(gx=self.gx - y, gy=self.gy + x)
        way, heading = noise.variances(distance, turn)
        for place, weight in _NODES:
            along_x, along_y = chord(distance * place, turn * place, yaw)
            angle = yaw + turn * place
            grown = grown.with_error(
                (math.cos(angle), math.sin(angle)), weight * way, (along_y - y, x - along_x), weight * heading
            )
        return grown

    def after_unknown(self, distance: float, turn: float) -> "PoseCovariance":
        """What it becomes where nobody knows how the base moved: by about `distance` m and `turn` rad, anywhere to."""
        turn = min(abs(turn), math.pi)
        everywhere = self._replace(xx=self.xx + distance * distance, yy=self.yy + distance * distance)
        return everywhere.with_error((0.0, 0.0), 0.0, (0.0, 0.0), turn * turn)

    def with_error(
        self, along: tuple[float, float], way: float, lever: tuple[float, float], heading: float
    ) -> "PoseCovariance":
        """What it becomes by an error of the way and one of the heading, independent of each other and of all before.

        Two errors of the heading with levers g and a are one with the weighted mean of both, and what is left is an
        error of the position: h q / (h + q) (g - a)(g - a)ᵀ (the parallel axis theorem).

        Args:
            along: the direction of the way, as a unit vector.
            way: variance, m².
            lever: how the position moves with this error of the heading, m/rad.
            heading: variance, rad².
        """
        total = self.heading + heading
        share = heading / total if total > 0.0 else 0.0
        x, y = lever[0] - self.gx, lever[1] - self.gy
        rest = self.heading * share
        return PoseCovariance(
            self.xx + way * along[0] * along[0] + rest * x * x,
            self.xy + way * along[0] * along[1] + rest * x * y,
            self.yy + way * along[1] * along[1] + rest * y * y,
            total,
            self.gx + share * x,
            self.gy + share * y,
        )


def twist_covariance(linear: float, angular: float) -> tuple[float, ...]:
    """As a message has it, 36 numbers: the variances of both velocities, m²/s² and rad²/s².

    A base with wheels does not slide sideways: of y it knows that it is nearly 0.
    """
    diagonal = (linear, linear, NOT_MEASURED, NOT_MEASURED, NOT_MEASURED, angular)
    return tuple(diagonal[i] if i == j else 0.0 for i in range(6) for j in range(6))
