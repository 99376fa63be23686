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


def multiply(p: FloatArray, q: FloatArray) -> FloatArray:
    """Hamilton product: `multiply(q_a_b, q_b_c)` is `q_a_c`."""
    p, q = np.asarray(p), np.asarray(q)
    pw, px, py, pz = (p[..., k] for k in range(4))
    qw, qx, qy, qz = (q[..., k] for k in range(4))
    product = np.empty((*np.broadcast(pw, qw).shape, 4))
    product[..., 0] = pw * qw - px * qx - py * qy - pz * qz
    product[..., 1] = pw * qx + px * qw + py * qz - pz * qy
    product[..., 2] = pw * qy - px * qz + py * qw + pz * qx
    product[..., 3] = pw * qz + px * qy - py * qx + pz * qw
    return product


def conjugate(q: FloatArray) -> FloatArray:
    """The opposite rotation: `conjugate(q_a_b)` is `q_b_a`."""
    opposite: FloatArray = np.asarray(q) * np.array([1.0, -1.0, -1.0, -1.0])
    return opposite


def normalise(q: FloatArray) -> FloatArray:
    unit: FloatArray = np.asarray(q) / np.linalg.norm(q, axis=-1, keepdims=True)
    return unit


def rotate(q: FloatArray, v: FloatArray) -> FloatArray:
    """`rotate(q_a_b, v_b)` is `v_a`."""
    q = np.asarray(q)
    v = np.asarray(v)
    w, u = q[..., :1], q[..., 1:]
    t = 2.0 * np.cross(u, v)
    rotated: FloatArray = v + w * t + np.cross(u, t)
    return rotated


def as_matrix(q: FloatArray) -> FloatArray:
    """Rotation matrices (..., 3, 3): `as_matrix(q_a_b) @ v_b` is `v_a`."""
    q = np.asarray(q)
    w, x, y, z = (q[..., k] for k in range(4))
    matrix = np.empty((*q.shape[:-1], 3, 3))
    matrix[..., 0, 0] = 1 - 2 * (y * y + z * z)
    matrix[..., 0, 1] = 2 * (x * y - w * z)
    matrix[..., 0, 2] = 2 * (x * z + w * y)
    matrix[..., 1, 0] = 2 * (x * y + w * z)
    matrix[..., 1, 1] = 1 - 2 * (x * x + z * z)
    matrix[..., 1, 2] = 2 * (y * z - w * x)
    matrix[..., 2, 0] = 2 * (x * z - w * y)
    matrix[..., 2, 1] = 2 * (y * z + w * x)
    matrix[..., 2, 2] = 1 - 2 * (x * x + y * y)
    return matrix


def from_rotation_vector(v: FloatArray) -> FloatArray:
    """The rotation about `v` by `|v|` rad, exact for every length."""
    v = np.asarray(v, dtype=np.float64)
    angle = np.linalg.norm(v, axis=-1, keepdims=True)
    # np.sinc(x) is sin(pi x) / (pi x): finite and exact at zero.
    return np.concatenate([np.cos(angle / 2), 0.5 * np.sinc(angle / (2 * np.pi)) * v], axis=-1)


def about_z(angle_rad: FloatArray) -> FloatArray:
    """The rotation about z, the room's vertical, by each angle."""
    half = np.asarray(angle_rad)[..., None] / 2
    zero = np.zeros_like(half)
    return np.concatenate([np.cos(half), zero, zero, np.sin(half)], axis=-1)


def slerp(p: FloatArray, q: FloatArray, share: FloatArray) -> FloatArray:
    """The rotation `share` of the shorter way from p to q; shapes (n, 4), (n, 4), (n,)."""
    cosine = np.sum(p * q, axis=-1)
    q = np.where(cosine[..., None] < 0.0, -q, q)
    angle = np.arccos(np.minimum(np.abs(cosine), 1.0))
    # np.sinc(x) is sin(pi x) / (pi x): finite and exact at zero.
    whole = np.sinc(angle / np.pi)
    from_p = (1.0 - share) * np.sinc((1.0 - share) * angle / np.pi) / whole
    from_q = share * np.sinc(share * angle / np.pi) / whole
    return normalise(from_p[..., None] * p + from_q[..., None] * q)


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
    across = np.cross(b, np.where(np.abs(b[..., :1]) < 0.9, [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]))
    across = across / np.linalg.norm(across, axis=-1, keepdims=True)
    turned = np.concatenate([1.0 + cosine, np.cross(b, a)], axis=-1)
    half_turn = np.concatenate([np.zeros_like(cosine), across], axis=-1)
    return normalise(np.where(cosine < -1.0 + 1e-12, half_turn, turned))


def up_in(q_ref_body: FloatArray) -> FloatArray:
    """The room's vertical in the body's frame."""
    w, x, y, z = np.moveaxis(np.asarray(q_ref_body), -1, 0)
    return np.stack([2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)], axis=-1)


def tilt_from_upright(q_ref_body: FloatArray) -> FloatArray:
    """Angle in [0, pi] between the body's z axis and the room's."""
    _, x, y, _ = np.moveaxis(np.asarray(q_ref_body), -1, 0)
    # 1 - cos(tilt) = 2 (x^2 + y^2): no loss of digits near upright.
    return np.asarray(2.0 * np.arcsin(np.sqrt(np.clip(x * x + y * y, 0.0, 1.0))))


def split_twist(q: FloatArray, axis: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Splits a rotation into twist about a unit `axis` and the rest.

    Returns the twist angle in [-pi, pi) and the angle of the rest (swing) in [0, pi].
    Source: Dobrowolski (2015), arXiv:1506.05481.
    """
    q = np.asarray(q)
    along = np.sum(q[..., 1:] * axis, axis=-1)
    twist = 2.0 * np.arctan2(along, q[..., 0])
    twist = np.mod(twist + np.pi, 2 * np.pi) - np.pi
    across = np.linalg.norm(q[..., 1:] - along[..., None] * axis, axis=-1)
    swing = 2.0 * np.arctan2(across, np.hypot(along, q[..., 0]))
    return np.asarray(twist), np.asarray(swing)


def from_source(q_source: FloatArray) -> FloatArray:
    """Our `q_ref_body` from the source's `[q1 q2 q3 q4]` (scalar last, A(q) takes ref to body)."""
    return np.asarray(q_source)[..., [3, 0, 1, 2]]


def to_source(q_ref_body: FloatArray) -> FloatArray:
    """The source's `[q1 q2 q3 q4]` from our `q_ref_body`."""
    return np.asarray(q_ref_body)[..., [1, 2, 3, 0]]
