"""The source's filter, equations (1)-(17), in its own convention: plain Python that Cython compiles when it can.

X = [q1 q2 q3 q4], scalar last, A(X) takes the room to the sensor. Matrices are kept row after row.
What was repaired, and no more: R keeps its first value until N innovations are there (16); eigenvalues of R (17) below
a floor are raised to it, because the difference (17) is not always a covariance; X is normalised after (11).
"""

from __future__ import annotations

import math


class SourceFilter:
    """The extended Kalman filter of (1)-(12); with `n_window` above 1, R adapts by (16) and (17)."""

    def __init__(self) -> None:
        self.gyr_var = 0.0  # Q is this times the identity, rad^2/s^2
        self.acc_var = 0.0  # R before it adapts, and the floor of its eigenvalues, m^2/s^4
        self.g = 0.0  # m/s^2
        self.n_window = 0
        self.x = [0.0, 0.0, 0.0, 1.0]
        self.p = [0.0] * 16
        self.r = [0.0] * 9
        self.n_seen = 0
        self.sum_y = [0.0] * 3
        self.sum_yy = [0.0] * 9
        self.sum_hph = [0.0] * 9

    def run(
        self,
        time_s: memoryview[float],
        gyr: memoryview[float],
        acc: memoryview[float],
        window: memoryview[float],
        out_x: memoryview[float],
        out_var: memoryview[float],
        out_r: memoryview[float],
    ) -> None:
        """From the second sample on; `window` (n_window, 12) holds the last innovations and H P H'.

        `out_var` is the variance of tilt per axis, `out_r` the trace of R over 3.
        """
        x = self.x
        p = self.p
        r = self.r
        f = [0.0] * 16
        g = [0.0] * 12
        h = [0.0] * 12
        y = [0.0] * 3
        k = [0.0] * 12
        ph = [0.0] * 12
        hph = [0.0] * 9
        s = [0.0] * 9
        work = [0.0] * 16
        for i in range(3):
            r[4 * i] = self.acc_var
        for n in range(len(time_s)):
            if n > 0:
                dt = time_s[n] - time_s[n - 1]
                wx = 0.5 * dt * gyr[n, 0]
                wy = 0.5 * dt * gyr[n, 1]
                wz = 0.5 * dt * gyr[n, 2]
                # (4)
                f[0] = f[5] = f[10] = f[15] = 1.0
                f[1] = f[11] = wz
                f[4] = f[14] = -wz
                f[2] = f[13] = -wy
                f[7] = f[8] = wy
                f[3] = f[6] = wx
                f[9] = f[12] = -wx
                # (5), of the state before
                c = 0.5 * dt
                g[0] = g[4] = g[8] = c * x[3]
                g[1] = -c * x[2]
                g[2] = c * x[1]
                g[3] = c * x[2]
                g[5] = -c * x[0]
                g[6] = -c * x[1]
                g[7] = c * x[0]
                g[9] = -c * x[0]
                g[10] = -c * x[1]
                g[11] = -c * x[2]
                # (2)
                for i in range(4):
                    work[i] = 0.0
                    for j in range(4):
                        work[i] += f[4 * i + j] * x[j]
                for i in range(4):
                    x[i] = work[i]
                # (3)
                for i in range(4):
                    for j in range(4):
                        c = 0.0
                        for m in range(4):
                            c += f[4 * i + m] * p[4 * m + j]
                        work[4 * i + j] = c
                for i in range(4):
                    for j in range(4):
                        c = 0.0
                        for m in range(4):
                            c += work[4 * i + m] * f[4 * j + m]
                        for m in range(3):
                            c += self.gyr_var * g[3 * i + m] * g[3 * j + m]
                        p[4 * i + j] = c
                # (9), (6)
                y[0] = acc[n, 0] - self.g * 2.0 * (x[0] * x[2] - x[1] * x[3])
                y[1] = acc[n, 1] - self.g * 2.0 * (x[1] * x[2] + x[0] * x[3])
                y[2] = acc[n, 2] - self.g * (-x[0] * x[0] - x[1] * x[1] + x[2] * x[2] + x[3] * x[3])
                # (10)
                c = 2.0 * self.g
                h[0] = h[5] = h[10] = c * x[2]
                h[1] = -c * x[3]
                h[2] = h[7] = c * x[0]
                h[3] = h[9] = -c * x[1]
                h[4] = h[11] = c * x[3]
                h[6] = c * x[1]
                h[8] = -c * x[0]
                for i in range(4):
                    for j in range(3):
                        c = 0.0
                        for m in range(4):
                            c += p[4 * i + m] * h[4 * j + m]
                        ph[3 * i + j] = c
                for i in range(3):
                    for j in range(3):
                        c = 0.0
                        for m in range(4):
                            c += h[4 * i + m] * ph[3 * m + j]
                        hph[3 * i + j] = c
                if self.n_window > 1:
                    self.adapt(window, y, hph)
                # (7)
                for i in range(9):
                    s[i] = hph[i] + r[i]
                invert(s, work)
                for i in range(4):
                    for j in range(3):
                        c = 0.0
                        for m in range(3):
                            c += ph[3 * i + m] * work[3 * m + j]
                        k[3 * i + j] = c
                # (11), normalised
                for i in range(4):
                    for j in range(3):
                        x[i] += k[3 * i + j] * y[j]
                c = 1.0 / math.sqrt(x[0] * x[0] + x[1] * x[1] + x[2] * x[2] + x[3] * x[3])
                for i in range(4):
                    x[i] *= c
                # (12)
                for i in range(4):
                    for j in range(4):
                        c = p[4 * i + j]
                        for m in range(3):
                            c -= k[3 * i + m] * ph[3 * j + m]
                        work[4 * i + j] = c
                for i in range(16):
                    p[i] = work[i]
            for i in range(4):
                out_x[n, i] = x[i]
            out_r[n] = (r[0] + r[4] + r[8]) / 3.0
            # An error dX turns the room by 2 dX (x) X*; its two level parts, as rows over [q1 q2 q3 q4].
            f[0] = x[3]
            f[1] = -x[2]
            f[2] = x[1]
            f[3] = -x[0]
            f[4] = x[2]
            f[5] = x[3]
            f[6] = -x[0]
            f[7] = -x[1]
            c = 0.0
            for i in range(4):
                for j in range(4):
                    c += (f[i] * f[j] + f[4 + i] * f[4 + j]) * p[4 * i + j]
            out_var[n] = 2.0 * c

    def adapt(self, window: memoryview[float], y: list[float], hph: list[float]) -> None:
        """(16) and (17) over the last `n_window` samples, this one among them."""
        n = self.n_window
        at = self.n_seen % n
        if self.n_seen >= n:
            for i in range(3):
                self.sum_y[i] -= window[at, i]
                for j in range(3):
                    self.sum_yy[3 * i + j] -= window[at, i] * window[at, j]
                    self.sum_hph[3 * i + j] -= window[at, 3 + 3 * i + j]
        for i in range(3):
            window[at, i] = y[i]
            self.sum_y[i] += y[i]
            for j in range(3):
                window[at, 3 + 3 * i + j] = hph[3 * i + j]
                self.sum_yy[3 * i + j] += y[i] * y[j]
                self.sum_hph[3 * i + j] += hph[3 * i + j]
        self.n_seen += 1
        if self.n_seen < n:
            return
        if at == n - 1:  # once a window the sums are taken afresh, so that rounding does not gather
            for i in range(3):
                self.sum_y[i] = 0.0
                for j in range(3):
                    self.sum_yy[3 * i + j] = 0.0
                    self.sum_hph[3 * i + j] = 0.0
            for m in range(n):
                for i in range(3):
                    self.sum_y[i] += window[m, i]
                    for j in range(3):
                        self.sum_yy[3 * i + j] += window[m, i] * window[m, j]
                        self.sum_hph[3 * i + j] += window[m, 3 + 3 * i + j]
        for i in range(3):
            for j in range(3):
                # sum of (Yj - mean)(Yj - mean)' is sum YY' - N mean mean'
                self.r[3 * i + j] = (self.sum_yy[3 * i + j] - self.sum_y[i] * self.sum_y[j] / n) / (
                    n - 1
                ) - self.sum_hph[3 * i + j] / n
        raise_eigenvalues(self.r, self.acc_var)


def invert(a: list[float], out: list[float]) -> None:
    """The inverse of a 3 x 3 matrix, by its adjugate."""
    out[0] = a[4] * a[8] - a[5] * a[7]
    out[1] = a[2] * a[7] - a[1] * a[8]
    out[2] = a[1] * a[5] - a[2] * a[4]
    out[3] = a[5] * a[6] - a[3] * a[8]
    out[4] = a[0] * a[8] - a[2] * a[6]
    out[5] = a[2] * a[3] - a[0] * a[5]
    out[6] = a[3] * a[7] - a[4] * a[6]
    out[7] = a[1] * a[6] - a[0] * a[7]
    out[8] = a[0] * a[4] - a[1] * a[3]
    scale = 1.0 / (a[0] * out[0] + a[1] * out[3] + a[2] * out[6])
    for i in range(9):
        out[i] *= scale


def raise_eigenvalues(a: list[float], floor: float) -> None:
    """Raises the eigenvalues of a symmetric 3 x 3 matrix to the floor; Jacobi's rotations."""
    v = [0.0] * 9
    d = [0.0] * 9
    for i in range(9):
        d[i] = a[i]
    v[0] = v[4] = v[8] = 1.0
    for _sweep in range(12):
        if d[1] * d[1] + d[2] * d[2] + d[5] * d[5] < 1e-28 * (d[0] * d[0] + d[4] * d[4] + d[8] * d[8]):
            break
        for i in range(2):
            for j in range(i + 1, 3):
                if d[3 * i + j] == 0.0:
                    continue
                theta = (d[4 * j] - d[4 * i]) / (2.0 * d[3 * i + j])
                t = 1.0 / (abs(theta) + math.sqrt(theta * theta + 1.0))
                if theta < 0.0:
                    t = -t
                c = 1.0 / math.sqrt(t * t + 1.0)
                s = t * c
                for m in range(3):
                    x = d[3 * m + i]
                    y = d[3 * m + j]
                    d[3 * m + i] = c * x - s * y
                    d[3 * m + j] = s * x + c * y
                    x = v[3 * m + i]
                    y = v[3 * m + j]
                    v[3 * m + i] = c * x - s * y
                    v[3 * m + j] = s * x + c * y
                for m in range(3):
                    x = d[3 * i + m]
                    y = d[3 * j + m]
                    d[3 * i + m] = c * x - s * y
                    d[3 * j + m] = s * x + c * y
    for i in range(3):
        for j in range(3):
            x = 0.0
            for m in range(3):
                x += v[3 * i + m] * max(d[4 * m], floor) * v[3 * j + m]
            a[3 * i + j] = x
