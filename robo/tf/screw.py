"""The arithmetic of rigid transforms: chains of them, and the screw motion from one to the next. Plain floats.

A transform is seven floats: its translation x, y, z in m and its rotation as a unit quaternion qx, qy, qz, qw. It takes
the coordinates p of a child frame to q p q* + (x, y, z) in the parent.

**The motion** between two transforms a and b is the one with a constant twist, that is the screw motion
a·exp(f·log(a⁻¹b)) for f from 0 to 1 (Lynch and Park 2017, Modern Robotics, §3.3.3; with dual quaternions it is the
ScLERP of Kavan, Collins, O'Sullivan and Žára 2006, Dual quaternions for rigid transformation blending). Logarithm and
exponential together leave something simple. With the rotation from a to b by the angle 2h about the unit axis u, in the
parent's axes, and d from a's origin to b's, the origin is at

    a + f d - sin(fh) sin((1-f)h) / sin(h) · u×d + (f - sin(fh) cos((1-f)h) / sin(h)) · u×(u×d)

and the rotation is (sin((1-f)h) qa + sin(fh) qb) / sin(h) (Shoemake 1985, Animating rotation with quaternion curves).

**The shortest way**: q and -q are one rotation, and b's is taken with the sign that makes h, the angle between the two
quaternions, at most π/2, so the turn 2h at most π. There sin(h) is small only where h is: near a turn of π nothing
special happens.

**Small turns**: what is known of the axis is w = sin(h) u, the vector part of the relative rotation, and it is off by
about 1e-16 however short it is. It stands in the terms in place of u, with the divisor sin(h) or sin²(h). The first of
the two factors is then about f(1-f), the second one off by less than 1e-16/sin²(h), so either term is off by about
1e-16 |d|: no series is needed. Only where sin²(h) is too small for a float the motion is taken for a straight line,
which it is to far more digits than a float has.
"""

from collections.abc import Iterable
from math import atan2, cos, sin, sqrt

Seven = tuple[float, float, float, float, float, float, float]
"""A transform: x, y, z in m, qx, qy, qz, qw."""

Bracket = tuple[float, ...]
"""A motion over a stretch of time, ready to be followed: its begin and end (ns, or any unit), what a unit of time is of
the whole, the seven of its first transform, the rotation of its last one, d, the cross products of w once and twice
with it, h in rad, sin(h)."""

_STRAIGHT = 1e-150
"""A sine whose square still has all digits of a float."""

_NOTHING = (0.0,) * 15


def held(begin: float, end: float, values: Seven) -> Bracket:
    """A transform that stays as it is."""
    return (begin, end, 0.0, *values, *_NOTHING)


def between(begin: float, end: float, ends: Iterable[float]) -> Bracket:
    """The motion between two transforms, given as fourteen floats, from one time to another."""
    ax, ay, az, qx, qy, qz, qw, dx, dy, dz, rx, ry, rz, rw = ends
    dx, dy, dz = dx - ax, dy - ay, dz - az
    near = qx * rx + qy * ry + qz * rz + qw * rw
    # The vector part of r q*.
    wx = rx * qw - rw * qx - ry * qz + rz * qy
    wy = ry * qw - rw * qy - rz * qx + rx * qz
    wz = rz * qw - rw * qz - rx * qy + ry * qx
    # Both ways are as short for half a turn: then the axis decides, so that r and -r are alike there too.
    if near <= 0.0 and (near < 0.0 or (wx, wy, wz) < (0.0, 0.0, 0.0)):
        near, rx, ry, rz, rw, wx, wy, wz = -near, -rx, -ry, -rz, -rw, -wx, -wy, -wz
    sine = sqrt(wx * wx + wy * wy + wz * wz)
    cx = cy = cz = ex = ey = ez = 0.0
    if dx or dy or dz:  # most joints of robots only turn
        cx, cy, cz = wy * dz - wz * dy, wz * dx - wx * dz, wx * dy - wy * dx
        ex, ey, ez = wy * cz - wz * cy, wz * cx - wx * cz, wx * cy - wy * cx
    h = atan2(sine, near)
    part = 1.0 / (end - begin)
    return begin, end, part, ax, ay, az, qx, qy, qz, qw, rx, ry, rz, rw, dx, dy, dz, cx, cy, cz, ex, ey, ez, h, sine


def followed(motions: Iterable[Bracket], time: float) -> Seven:
    """The product of a chain of motions at a time: the first one takes the innermost frame into the next."""
    px = py = pz = x = y = z = 0.0
    w = 1.0
    first = True
    for motion in motions:
        begin, _, part, ax, ay, az, qx, qy, qz, qw, rx, ry, rz, rw, dx, dy, dz, cx, cy, cz, ex, ey, ez, h, sine = motion
        f = (time - begin) * part
        if sine > _STRAIGHT:
            to = f * h
            back = h - to
            there = sin(to) / sine
            here = sin(back) / sine
            if dx or dy or dz:
                side = there * here
                inward = (f - there * cos(back)) / (sine * sine)
                ax += f * dx - side * cx + inward * ex
                ay += f * dy - side * cy + inward * ey
                az += f * dz - side * cz + inward * ez
            qx = here * qx + there * rx
            qy = here * qy + there * ry
            qz = here * qz + there * rz
            qw = here * qw + there * rw
        else:
            ax += f * dx
            ay += f * dy
            az += f * dz
        if first:  # the product with the identity would take as long as any other
            px, py, pz, x, y, z, w = ax, ay, az, qx, qy, qz, qw
            first = False
            continue
        # p becomes q p q* + a, that is p + 2 qw (v×p) + 2 v×(v×p) + a with q's vector part v (Euler-Rodrigues).
        tx = 2.0 * (qy * pz - qz * py)
        ty = 2.0 * (qz * px - qx * pz)
        tz = 2.0 * (qx * py - qy * px)
        px += ax + qw * tx + qy * tz - qz * ty
        py += ay + qw * ty + qz * tx - qx * tz
        pz += az + qw * tz + qx * ty - qy * tx
        tx = qw * x + qx * w + qy * z - qz * y
        ty = qw * y - qx * z + qy * w + qz * x
        tz = qw * z + qx * y - qy * x + qz * w
        w = qw * w - qx * x - qy * y - qz * z
        x, y, z = tx, ty, tz
    return px, py, pz, x, y, z, w


def relative(base: Seven, other: Seven) -> Seven:
    """The product of a base's inverse with another transform: where `other` stands in `base`."""
    bx, by, bz, qx, qy, qz, qw = base
    px, py, pz, x, y, z, w = other
    px, py, pz = px - bx, py - by, pz - bz
    tx, ty, tz = 2.0 * (qz * py - qy * pz), 2.0 * (qx * pz - qz * px), 2.0 * (qy * px - qx * py)
    return (
        px + qw * tx - qy * tz + qz * ty,
        py + qw * ty - qz * tx + qx * tz,
        pz + qw * tz - qx * ty + qy * tx,
        qw * x - qx * w - qy * z + qz * y,
        qw * y + qx * z - qy * w - qz * x,
        qw * z - qx * y + qy * x - qz * w,
        qw * w + qx * x + qy * y + qz * z,
    )
