"""How the errors of an attitude filter grow and shrink: plain Python that Cython compiles, as `_attitude_kernel.py`.

The error state, always estimate less truth, is
    0, 1  tilt about the room's x and y (rad)
    2, 3  horizontal velocity in the room (m/s)
    4, 5, 6  gyro bias on the sensor's axes (rad/s)
    7 to 15  gyro scale, row by row: of the rate less its bias, this share is not there (scales and crossed axes)
and its covariance is kept as 16 rows of 16. Only the first `end` errors are estimated, 16 or 8; of an error that is
not, variance and value stay what they are. Below the first four rows, their columns are left out: they are the rows.
"""

from __future__ import annotations


class Errors:
    """The covariance, what was gathered since the last correction, and what that correction was."""

    def __init__(self) -> None:
        self.end = 16
        self.p = [0.0] * 256
        # gathered since the last correction: the time, what bias and scale do to tilt, tilt to velocity, and the noise
        self.dt = 0.0
        self.a = [0.0] * 24
        self.c = 0.0
        self.tilt_noise = 0.0
        self.velocity_noise = 0.0
        # the last correction: the errors found; of each measurement its error, gain, y / s and 1 / s
        self.d = [0.0] * 16
        self.n_updates = 0
        self.i = [0] * 5
        self.k = [0.0] * 80
        self.y = [0.0] * 5
        self.s = [0.0] * 5

    def take(self, other: Errors) -> None:
        """Takes over covariance and what was gathered."""
        for i in range(256):
            self.p[i] = other.p[i]
        for i in range(24):
            self.a[i] = other.a[i]
        self.dt = other.dt
        self.c = other.c
        self.tilt_noise = other.tilt_noise
        self.velocity_noise = other.velocity_noise

    def gather(self) -> None:
        """Begins a new interval between corrections."""
        for i in range(24):
            self.a[i] = 0.0
        self.c = 0.0
        self.tilt_noise = 0.0
        self.velocity_noise = 0.0
        self.dt = 0.0

    def grow(self, bias_q: float) -> None:
        """The covariance at the end of the interval: P = F P F' + Q."""
        p = self.p
        a = self.a
        c = self.c
        t = [0.0] * 16
        u = [0.0] * 16
        # Tilt takes bias and scale: from the old covariance with them, once as row and once as column, to the new.
        s00 = 0.0
        s01 = 0.0
        s11 = 0.0
        for i in range(4, self.end):
            s00 += a[i - 4] * p[i]
            s01 += a[i - 4] * p[16 + i]
            s11 += a[8 + i] * p[16 + i]
            p[2] += a[i - 4] * p[32 + i]
            p[3] += a[i - 4] * p[48 + i]
            p[18] += a[8 + i] * p[32 + i]
            p[19] += a[8 + i] * p[48 + i]
        for j in range(4, self.end):
            t[j] = p[j]
            u[j] = p[16 + j]
        for i in range(4, self.end, 4):  # four rows side by side: compilers turn this into vector instructions
            for j in range(4, self.end):
                t[j] += (
                    a[i - 4] * p[16 * i + j]
                    + a[i - 3] * p[16 * i + 16 + j]
                    + a[i - 2] * p[16 * i + 32 + j]
                    + a[i - 1] * p[16 * i + 48 + j]
                )
                u[j] += (
                    a[8 + i] * p[16 * i + j]
                    + a[9 + i] * p[16 * i + 16 + j]
                    + a[10 + i] * p[16 * i + 32 + j]
                    + a[11 + i] * p[16 * i + 48 + j]
                )
        for j in range(4, self.end):
            p[j] = t[j]
            p[16 + j] = u[j]
            p[32 + j] += c * u[j]  # velocity takes tilt
            p[48 + j] -= c * t[j]
        for i in range(4, self.end):
            s00 += a[i - 4] * p[i]
            s01 += a[8 + i] * p[i]
            s11 += a[8 + i] * p[16 + i]
        p[0] += s00 + self.tilt_noise
        p[1] += s01
        p[17] += s11 + self.tilt_noise
        p[34] += c * (2.0 * p[18] + c * p[17]) + self.velocity_noise
        p[35] += c * (p[19] - p[2] - c * p[1])
        p[51] += c * (c * p[0] - 2.0 * p[3]) + self.velocity_noise
        p[2] += c * p[1]
        p[18] += c * p[17]
        p[3] -= c * p[0]
        p[19] -= c * p[1]
        p[16] = p[1]
        p[32] = p[2]
        p[33] = p[18]
        p[48] = p[3]
        p[49] = p[19]
        p[50] = p[35]
        for i in range(4, 7):
            p[17 * i] += self.dt * bias_q

    def update_velocity(self, vx: float, vy: float, var: float) -> None:
        """The two velocities, one after the other, as `update` would; the covariance is gone through once."""
        p = self.p
        h = [0.0] * 16
        k = [0.0] * 16
        h2 = [0.0] * 16
        k2 = [0.0] * 16
        s = 1.0 / (p[34] + var)
        for j in range(self.end):
            h[j] = p[32 + j]
        for j in range(self.end):
            k[j] = h[j] * s
        c = k[3]
        for j in range(self.end):
            h2[j] = p[48 + j] - c * h[j]
        s2 = 1.0 / (h2[3] + var)
        for j in range(self.end):
            k2[j] = h2[j] * s2
        y2 = vy - c * vx
        for j in range(self.end):
            self.d[j] = k[j] * vx + k2[j] * y2
        for i in range(4):
            for j in range(self.end):
                p[16 * i + j] -= h[i] * k[j] + h2[i] * k2[j]
        for i in range(4, self.end):
            for j in range(4, self.end):
                p[16 * i + j] -= h[i] * k[j] + h2[i] * k2[j]
        for j in range(self.end):
            self.k[j] = k[j]
            self.k[16 + j] = k2[j]
        self.i[0] = 2
        self.i[1] = 3
        self.y[0] = vx * s
        self.y[1] = y2 * s2
        self.s[0] = s
        self.s[1] = s2
        self.n_updates = 2

    def update(self, i: int, error: float, var: float) -> None:
        """One scalar measurement of error i, a bias, with its variance."""
        p = self.p
        h = [0.0] * 16
        k = [0.0] * 16
        s = 1.0 / (p[17 * i] + var)
        y = error - self.d[i]
        for j in range(4):
            h[j] = p[16 * j + i]
        for j in range(4, self.end):
            h[j] = p[16 * i + j]
        for j in range(self.end):
            k[j] = h[j] * s
        for j in range(self.end):
            self.d[j] += k[j] * y
        for m in range(4):
            for j in range(self.end):
                p[16 * m + j] -= h[m] * k[j]
        for m in range(4, self.end):
            for j in range(4, self.end):
                p[16 * m + j] -= h[m] * k[j]
        for j in range(self.end):
            self.k[16 * self.n_updates + j] = k[j]
        self.i[self.n_updates] = i
        self.y[self.n_updates] = y * s
        self.s[self.n_updates] = s
        self.n_updates += 1
