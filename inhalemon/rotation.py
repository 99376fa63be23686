"""Quaternions: unit, Hamilton, scalar first `[w, x, y, z]`; `q_a_b` takes vectors written in b and gives them in a.

Every function takes arrays of shape (..., 4) or (..., 3) and broadcasts. `q` and `-q` are the same rotation.

The source of the method writes the scalar last and the opposite direction (ref -> body): with its
`[q1 q2 q3 q4]`, A(q) v = q* v q. For the same attitude, its quaternion read as scalar first, `[q4, q1, q2, q3]`,
is ours, `q_ref_body`, and its matrix A is our `q_body_ref` (`as_matrix(conjugate(q))`). `from_source` and `to_source`
change between the two.
"""

from __future__ import annotations

import numpy as np

from inhalemon.values import FloatArray

IDENTITY: FloatArray = np.array([1.0, 0.0, 0.0, 0.0])
IDENTITY.flags.writeable = False


def components(v: FloatArray) -> FloatArray:
    """The components of quaternions or vectors, each for all of them: (4, ...) from (..., 4), contiguous.

    Arithmetic on one component after the other is some five times as fast as on four-tuples.
    """
    v = np.asarray(v)
    return np.ascontiguousarray(v.T if v.ndim < 3 else np.moveaxis(v, -1, 0))


def from_components(*parts: FloatArray) -> FloatArray:
    """Quaternions or vectors (..., k) from their k components of equal shape; a view with the components outermost."""
    joined = np.array(parts)
    return joined.T if joined.ndim < 3 else np.moveaxis(joined, 0, -1)


def multiply(p: FloatArray, q: FloatArray) -> FloatArray:
    """Hamilton product: `multiply(q_a_b, q_b_c)` is `q_a_c`."""
    pw, px, py, pz = components(p)
    qw, qx, qy, qz = components(q)
    return from_components(
        pw * qw - px * qx - py * qy - pz * qz,
        pw * qx + px * qw + py * qz - pz * qy,
        pw * qy - px * qz + py * qw + pz * qx,
        pw * qz + px * qy - py * qx + pz * qw,
    )


def conjugate(q: FloatArray) -> FloatArray:
    """The opposite rotation: `conjugate(q_a_b)` is `q_b_a`."""
    w, x, y, z = components(q)
    return from_components(w, -x, -y, -z)


def normalise(q: FloatArray) -> FloatArray:
    w, x, y, z = components(q)
    unit: FloatArray = np.asarray(q) / np.sqrt(w * w + x * x + y * y + z * z)[..., None]
    return unit


def rotate(q: FloatArray, v: FloatArray) -> FloatArray:
    """`rotate(q_a_b, v_b)` is `v_a`."""
    w, x, y, z = components(q)
    a, b, c = components(v)
    ta, tb, tc = 2.0 * (y * c - z * b), 2.0 * (z * a - x * c), 2.0 * (x * b - y * a)
    return from_components(
        a + w * ta + (y * tc - z * tb),
        b + w * tb + (z * ta - x * tc),
        c + w * tc + (x * tb - y * ta),
    )


def as_matrix(q: FloatArray) -> FloatArray:
    """Rotation matrices (..., 3, 3): `as_matrix(q_a_b) @ v_b` is `v_a`."""
    w, x, y, z = components(q)
    rows = np.array(
        (
            (1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)),
            (2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)),
            (2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)),
        )
    )
    return rows if rows.ndim == 2 else np.moveaxis(rows, (0, 1), (-2, -1))


def from_rotation_vector(v: FloatArray) -> FloatArray:
    """The rotation about `v` by `|v|` rad, exact for every length."""
    x, y, z = components(v)
    angle = np.sqrt(x * x + y * y + z * z)
    # np.sinc(x) is sin(pi x) / (pi x): finite and exact at zero.
    scale = 0.5 * np.sinc(angle / (2 * np.pi))
    return from_components(np.cos(angle / 2), scale * x, scale * y, scale * z)


def about_z(angle_rad: FloatArray) -> FloatArray:
    """The rotation about z, the room's vertical, by each angle."""
    half = np.asarray(angle_rad) / 2
    zero = np.zeros_like(half)
    return from_components(np.cos(half), zero, zero, np.sin(half))


def heading_of_y(q: FloatArray) -> FloatArray:
    """The heading (n,) of the frame's y in the room: 0 along the room's x, a quarter turn along its y."""
    w, x, y, z = components(q)
    heading: FloatArray = np.arctan2(0.5 - x * x - z * z, x * y - w * z)
    return heading


def turned_about_z(angle_rad: FloatArray, q: FloatArray) -> FloatArray:
    """`multiply(about_z(angle_rad), q)`, without the zeros."""
    cosine, sine = np.cos(np.asarray(angle_rad) / 2), np.sin(np.asarray(angle_rad) / 2)
    w, x, y, z = components(q)
    return from_components(cosine * w - sine * z, cosine * x - sine * y, cosine * y + sine * x, cosine * z + sine * w)


def slerp(p: FloatArray, q: FloatArray, share: FloatArray) -> FloatArray:
    """The rotation `share` of the shorter way from p to q; shapes (n, 4), (n, 4), (n,)."""
    p, q = components(p), components(q)
    cosine = p[0] * q[0] + p[1] * q[1] + p[2] * q[2] + p[3] * q[3]
    angle = np.arccos(np.minimum(np.abs(cosine), 1.0))
    sine = np.maximum(np.sin(angle), 1e-300)  # of equal rotations, of which p's share is then nothing
    from_q = np.where(angle > 0.0, np.sin(share * angle) / sine, 1.0)
    from_p = np.where(angle > 0.0, np.sin((1.0 - share) * angle) / sine, 0.0)
    return normalise((from_p * p + np.copysign(from_q, cosine) * q).T)


def to_rotation_vector(q: FloatArray) -> FloatArray:
    """The shortest rotation vector, length within [0, pi]."""
    q = np.asarray(q)
    q = np.where(q[..., :1] < 0, -q, q)
    sine = np.linalg.norm(q[..., 1:], axis=-1, keepdims=True)
    half = np.arctan2(sine, q[..., :1])
    scale = np.divide(2 * half, sine, out=np.full_like(sine, 2.0), where=sine > 1e-12)
    vector: FloatArray = scale * q[..., 1:]
    return vector


def angle_between(p: FloatArray, q: FloatArray) -> FloatArray:
    """The angle in [0, pi] that turns one attitude into the other."""
    return np.asarray(np.linalg.norm(to_rotation_vector(multiply(conjugate(p), q)), axis=-1))


def from_two_vectors(v_a: FloatArray, v_b: FloatArray) -> FloatArray:
    """The smallest rotation `q_a_b` with `rotate(q_a_b, v_b)` along `v_a`; shapes (..., 3)."""
    a = np.asarray(v_a) / np.linalg.norm(v_a, axis=-1, keepdims=True)
    b = np.asarray(v_b) / np.linalg.norm(v_b, axis=-1, keepdims=True)
    cosine = np.sum(a * b, axis=-1, keepdims=True)
    # Opposite vectors: half a turn about any axis across b.
    across = _cross(b, np.where(np.abs(b[..., :1]) < 0.9, [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]))
    turned = np.concatenate([1.0 + cosine, _cross(b, a)], axis=-1)
    half_turn = np.concatenate([np.zeros_like(cosine), across], axis=-1)
    return normalise(np.where(cosine < -1.0 + 1e-12, half_turn, turned))


def _cross(v: FloatArray, w: FloatArray) -> FloatArray:
    a, b, c = components(v)
    x, y, z = components(w)
    return from_components(b * z - c * y, c * x - a * z, a * y - b * x)


def up_in(q_ref_body: FloatArray) -> FloatArray:
    """The room's vertical in the body's frame."""
    w, x, y, z = components(q_ref_body)
    return from_components(2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y))


def tilt_from_upright(q_ref_body: FloatArray) -> FloatArray:
    """Angle in [0, pi] between the body's z axis and the room's."""
    _, x, y, _ = components(q_ref_body)
    # 1 - cos(tilt) = 2 (x^2 + y^2): no loss of digits near upright.
    return np.asarray(2.0 * np.arcsin(np.sqrt(np.clip(x * x + y * y, 0.0, 1.0))))


def split_twist(q: FloatArray, axis: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Splits a rotation into twist about a unit `axis` and the rest.

    Returns the twist angle in [-pi, pi) and the angle of the rest (swing) in [0, pi].
    Source: Dobrowolski (2015), arXiv:1506.05481.
    """
    w, x, y, z = components(q)
    a, b, c = components(axis)
    along = x * a + y * b + z * c
    twist = 2.0 * np.arctan2(along, w)
    twist = twist - 2.0 * np.pi * np.floor((twist + np.pi) / (2.0 * np.pi))
    across = np.sqrt((x - along * a) ** 2 + (y - along * b) ** 2 + (z - along * c) ** 2)
    swing = 2.0 * np.arctan2(across, np.sqrt(along * along + w * w))
    return np.asarray(twist), np.asarray(swing)


def from_source(q_source: FloatArray) -> FloatArray:
    """Our `q_ref_body` from the source's `[q1 q2 q3 q4]` (scalar last, A(q) takes ref to body)."""
    return np.asarray(q_source)[..., [3, 0, 1, 2]]


def to_source(q_ref_body: FloatArray) -> FloatArray:
    """The source's `[q1 q2 q3 q4]` from our `q_ref_body`."""
    return np.asarray(q_ref_body)[..., [1, 2, 3, 0]]
