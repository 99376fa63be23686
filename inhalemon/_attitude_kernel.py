"""The attitude filter, sample by sample: plain Python that Cython compiles when there is a C compiler.

`_attitude_kernel.pxd` gives the C types; both forms do the same operations in the same order, so their results are
the same to the bit. What the filter does and why is told in `stages/attitude.py` and docs/method.md.

The error state, always estimate less truth, is
    0, 1  tilt about the room's x and y (rad)
    2, 3  horizontal velocity in the room (m/s)
    4, 5, 6  gyro bias on the sensor's axes (rad/s)
    7 to 15  gyro scale, row by row: of the rate less its bias, this share is not there (scales and crossed axes)
and its covariance is kept as 16 rows of 16. Only the first `end` errors are estimated, 16 or 8; of an error that is
not, variance and value stay what they are. Below the first four rows, their columns are left out: they are the rows.
"""

from __future__ import annotations

import math


class AttitudeFilter:
    """A filter's numbers and its state. Fields ending in `_q` are spectral densities of a noise.

    `step` takes one sample; `run` takes many and writes what came out. Both leave the state after the last sample.
    """

    def __init__(self) -> None:
        # the numbers of AttitudeSettings, in the form the filter uses
        self.update_s = 0.0
        self.gyr_delay_s = 0.0
        self.gyr_q = 0.0  # rad^2/s
        self.rate_q = 0.0  # s: angle variance grows by rate_q |w|^2 per second
        self.bias_q = 0.0  # rad^2/s^3
        self.acc_q = 0.0  # m^2/s^3
        self.clip_rate = 0.0  # rad/s
        self.clip_acc = 0.0  # m/s^2
        self.gyr_saturated_q = 0.0  # rad^2/s
        self.acc_saturated_q = 0.0  # m^2/s^3
        self.start_s = 0.0
        self.gap_s = 0.0
        self.reset_gap_s = 0.0
        self.gap_rate_var = 0.0  # rad^2/s^2
        self.gap_acc_var = 0.0  # m^2/s^4
        self.tilt_var = 0.0  # rad^2, at the start
        self.velocity_var = 0.0  # m^2/s^2, at the start
        self.bias_var = 0.0  # rad^2/s^2, at the start
        self.scale_var = 0.0  # at the start
        self.end = 16
        self.r_factor = 0.0  # s: the measurement's density is r_factor times the velocity's variance
        self.r_start = 0.0  # m^2/s^2
        self.r_start_s = 0.0
        self.r_floor = 0.0  # m^2/s^2
        self.r_largest = 0.0  # m^2/s^2
        self.r_is_constant = False
        self.window_s = 0.0
        self.rest_rate = 0.0  # rad/s, largest deviation at rest
        self.rest_acc = 0.0  # m/s^2
        self.rest_min_s = 0.0
        self.rest_bias_q = 0.0  # rad^2/s
        self.rest_bias_gate = 0.0  # rad^2/s^2
        self.rest_r = 0.0  # m^2/s, density
        # the state
        self.is_started = False
        self.started_s = 0.0
        self.start_f = [0.0] * 3
        self.q = [1.0, 0.0, 0.0, 0.0]
        self.b = [0.0] * 3
        self.scale = [0.0] * 9
        self.v = [0.0] * 2
        self.p = [0.0] * 256
        self.w = [0.0] * 3  # the last rate as it was read
        self.e = [0.0] * 3  # less its bias
        self.g = [0.0] * 3  # and less what the scales add
        self.acc = [0.0] * 3  # the last specific force as it was read
        self.largest_rate = 0.0
        self.largest_acc = 0.0
        self.gyr_same = 0
        self.acc_same = 0
        self.f = [0.0] * 2  # the last horizontal specific force in the room
        self.mean_y = [0.0] * 2
        self.mean_yy = 0.0
        self.mean_hph = 0.0
        self.hph = 0.0
        self.seen_s = 0.0
        self.rest_w = [0.0] * 3
        self.rest_a = [0.0] * 3
        self.rest_s = 0.0
        self.has_rested = False
        self.r = 0.0  # m^2/s^2, the velocity's variance as the window shows it
        # gathered since the last correction: the time, what bias does to tilt, tilt to velocity, and the noise
        self.dt = 0.0
        self.a = [0.0] * 24
        self.c = 0.0
        self.tilt_noise = 0.0
        self.velocity_noise = 0.0
        # of the last correction, for the smoother
        self.event = 0  # of the last sample: nothing, corrected, started
        self.d = [0.0] * 16
        self.n_updates = 0
        self.i = [0] * 5
        self.k = [0.0] * 80
        self.y = [0.0] * 5
        self.s = [0.0] * 5

    def start(self, dt: float, ax: float, ay: float, az: float) -> None:
        """Turns the room so that the mean specific force since the start, carried along by the gyro, points up."""
        q = self.q
        m = self.start_f
        self.started_s += dt
        g = dt / self.started_s if self.started_s > 0.0 else 1.0
        fx = (1.0 - 2.0 * (q[2] * q[2] + q[3] * q[3])) * ax + 2.0 * (
            (q[1] * q[2] - q[0] * q[3]) * ay + (q[1] * q[3] + q[0] * q[2]) * az
        )
        fy = (1.0 - 2.0 * (q[1] * q[1] + q[3] * q[3])) * ay + 2.0 * (
            (q[1] * q[2] + q[0] * q[3]) * ax + (q[2] * q[3] - q[0] * q[1]) * az
        )
        fz = (1.0 - 2.0 * (q[1] * q[1] + q[2] * q[2])) * az + 2.0 * (
            (q[1] * q[3] - q[0] * q[2]) * ax + (q[2] * q[3] + q[0] * q[1]) * ay
        )
        m[0] += g * (fx - m[0])
        m[1] += g * (fy - m[1])
        m[2] += g * (fz - m[2])
        fx = m[0]
        fy = m[1]
        fz = m[2]
        n = (fx * fx + fy * fy + fz * fz) ** 0.5
        if n == 0.0:
            return
        m[0] = 0.0
        m[1] = 0.0
        m[2] = n
        cw = n + fz
        cx = fy
        cy = -fx
        if cw < 1e-9 * n:  # upside down: half a turn about x
            cw = 0.0
            cx = 1.0
            cy = 0.0
        n = (cw * cw + cx * cx + cy * cy) ** 0.5
        cw /= n
        cx /= n
        cy /= n
        qw = q[0]
        qx = q[1]
        qy = q[2]
        qz = q[3]
        q[0] = cw * qw - cx * qx - cy * qy
        q[1] = cw * qx + cx * qw + cy * qz
        q[2] = cw * qy - cx * qz + cy * qw
        q[3] = cw * qz + cx * qy - cy * qx

    def begin(self) -> None:
        """Forgets all but attitude, bias and scale; the first time, what is known of those too."""
        p = self.p
        for i in range(64):
            p[i] = 0.0
        if not self.is_started:
            for i in range(64, 256):
                p[i] = 0.0
            for i in range(4, 7):
                p[17 * i] = self.bias_var
            for i in range(7, self.end):
                p[17 * i] = self.scale_var
        p[0] = self.tilt_var
        p[17] = self.tilt_var
        p[34] = self.velocity_var
        p[51] = self.velocity_var
        for i in range(2):
            self.v[i] = 0.0
            self.f[i] = 0.0
            self.mean_y[i] = 0.0
        self.gather()
        self.n_updates = 0
        self.mean_yy = 2.0 * self.r_start
        self.mean_hph = 0.0
        self.seen_s = self.r_start_s
        self.rest_s = 0.0
        self.r = self.r_start
        self.is_started = True

    def take(self, other: AttitudeFilter) -> None:
        """Takes over the state of another filter, not its numbers."""
        self.is_started = other.is_started
        self.started_s = other.started_s
        for i in range(3):
            self.start_f[i] = other.start_f[i]
        for i in range(4):
            self.q[i] = other.q[i]
        for i in range(3):
            self.b[i] = other.b[i]
            self.w[i] = other.w[i]
            self.e[i] = other.e[i]
            self.g[i] = other.g[i]
            self.acc[i] = other.acc[i]
            self.rest_w[i] = other.rest_w[i]
            self.rest_a[i] = other.rest_a[i]
        for i in range(2):
            self.v[i] = other.v[i]
            self.f[i] = other.f[i]
            self.mean_y[i] = other.mean_y[i]
        for i in range(9):
            self.scale[i] = other.scale[i]
        for i in range(256):
            self.p[i] = other.p[i]
        for i in range(24):
            self.a[i] = other.a[i]
        self.largest_rate = other.largest_rate
        self.largest_acc = other.largest_acc
        self.gyr_same = other.gyr_same
        self.acc_same = other.acc_same
        self.mean_yy = other.mean_yy
        self.mean_hph = other.mean_hph
        self.seen_s = other.seen_s
        self.rest_s = other.rest_s
        self.has_rested = other.has_rested
        self.r = other.r
        self.dt = other.dt
        self.c = other.c
        self.tilt_noise = other.tilt_noise
        self.velocity_noise = other.velocity_noise
        self.event = other.event

    def gather(self) -> None:
        """Begins a new interval between corrections."""
        for i in range(24):
            self.a[i] = 0.0
        self.c = 0.0
        self.tilt_noise = 0.0
        self.velocity_noise = 0.0
        self.dt = 0.0

    def step(
        self, dt: float, wx: float, wy: float, wz: float, ax: float, ay: float, az: float, flags: int, r_given: float
    ) -> None:
        """Takes the sample that comes `dt` after the last one (of the first, `dt` does not matter).

        `flags` has bit 1 for a saturated rate, bit 2 for saturated specific force. `r_given` is the velocity's
        variance to use; negative: from the window over the past.
        """
        q = self.q
        a = self.a
        e = self.e
        g = self.g
        if self.event != 0:  # the last sample closed an interval; its numbers stood until now for who wanted them
            self.gather()
        self.event = 0
        if not self.is_started or dt > self.reset_gap_s:
            self.w[0] = wx
            self.w[1] = wy
            self.w[2] = wz
            self.take_rate()
            self.started_s = 0.0
            self.begin()
            self.start(0.0, ax, ay, az)
            self.event = 2
            return
        # A reading that is the same three times, and no axis ever read more, is one that the chip could not follow.
        c = self.largest_rate
        if abs(wx) > c or abs(wy) > c or abs(wz) > c:
            self.largest_rate = max(abs(wx), abs(wy), abs(wz))
            self.gyr_same = 0
        elif wx == self.w[0] or wy == self.w[1] or wz == self.w[2]:
            c = max(0.999 * c, self.clip_rate)
            if (
                (wx == self.w[0] and abs(wx) > c)
                or (wy == self.w[1] and abs(wy) > c)
                or (wz == self.w[2] and abs(wz) > c)
            ):
                self.gyr_same += 1
                if self.gyr_same > 1:
                    flags |= 1
            else:
                self.gyr_same = 0
        else:
            self.gyr_same = 0
        c = self.largest_acc
        if abs(ax) > c or abs(ay) > c or abs(az) > c:
            self.largest_acc = max(abs(ax), abs(ay), abs(az))
            self.acc_same = 0
        elif ax == self.acc[0] or ay == self.acc[1] or az == self.acc[2]:
            c = max(0.999 * c, self.clip_acc)
            if (
                (ax == self.acc[0] and abs(ax) > c)
                or (ay == self.acc[1] and abs(ay) > c)
                or (az == self.acc[2] and abs(az) > c)
            ):
                self.acc_same += 1
                if self.acc_same > 1:
                    flags |= 2
            else:
                self.acc_same = 0
        else:
            self.acc_same = 0
        self.acc[0] = ax
        self.acc[1] = ay
        self.acc[2] = az
        ux = g[0]
        uy = g[1]
        uz = g[2]
        hx = e[0]
        hy = e[1]
        hz = e[2]
        self.w[0] = wx
        self.w[1] = wy
        self.w[2] = wz
        self.take_rate()
        gx = g[0]
        gy = g[1]
        gz = g[2]
        hx = 0.5 * dt * (hx + e[0])
        hy = 0.5 * dt * (hy + e[1])
        hz = 0.5 * dt * (hz + e[2])
        self.integrate(dt, ux, uy, uz, gx, gy, gz)
        if self.started_s < self.start_s:
            self.start(dt, ax, ay, az)
            self.look_for_rest(dt, wx, wy, wz, ax, ay, az)
            c = self.tilt_var / (1.0 + self.tilt_var * 48.0 * self.started_s * self.started_s / self.velocity_var)
            self.p[0] = c
            self.p[17] = c
            self.event = 2
            return
        # Specific force in the room, gathered into velocity.
        r00 = 1.0 - 2.0 * (q[2] * q[2] + q[3] * q[3])
        r01 = 2.0 * (q[1] * q[2] - q[0] * q[3])
        r02 = 2.0 * (q[1] * q[3] + q[0] * q[2])
        r10 = 2.0 * (q[1] * q[2] + q[0] * q[3])
        r11 = 1.0 - 2.0 * (q[1] * q[1] + q[3] * q[3])
        r12 = 2.0 * (q[2] * q[3] - q[0] * q[1])
        # How the errors grow meanwhile: bias and scale tilt.
        a[0] -= dt * r00
        a[1] -= dt * r01
        a[2] -= dt * r02
        a[12] -= dt * r10
        a[13] -= dt * r11
        a[14] -= dt * r12
        if self.end > 8:
            a[3] -= r00 * hx
            a[4] -= r00 * hy
            a[5] -= r00 * hz
            a[6] -= r01 * hx
            a[7] -= r01 * hy
            a[8] -= r01 * hz
            a[9] -= r02 * hx
            a[10] -= r02 * hy
            a[11] -= r02 * hz
            a[15] -= r10 * hx
            a[16] -= r10 * hy
            a[17] -= r10 * hz
            a[18] -= r11 * hx
            a[19] -= r11 * hy
            a[20] -= r11 * hz
            a[21] -= r12 * hx
            a[22] -= r12 * hy
            a[23] -= r12 * hz
        # The gyro is late: by the time of this specific force the part has turned on.
        c = self.gyr_delay_s
        hx = ax + c * (gy * az - gz * ay)
        hy = ay + c * (gz * ax - gx * az)
        az += c * (gx * ay - gy * ax)
        ax = hx
        ay = hy
        fx = r00 * ax + r01 * ay + r02 * az
        fy = r10 * ax + r11 * ay + r12 * az
        fz = (
            2.0 * ((q[1] * q[3] - q[0] * q[2]) * ax + (q[2] * q[3] + q[0] * q[1]) * ay)
            + (1.0 - 2.0 * (q[1] * q[1] + q[2] * q[2])) * az
        )
        self.v[0] += 0.5 * dt * (self.f[0] + fx)
        self.v[1] += 0.5 * dt * (self.f[1] + fy)
        self.f[0] = fx
        self.f[1] = fy
        self.c += dt * fz  # tilt accelerates
        self.tilt_noise += dt * (self.gyr_q + self.rate_q * (gx * gx + gy * gy + gz * gz))
        self.velocity_noise += dt * self.acc_q
        if flags & 1:
            self.tilt_noise += dt * self.gyr_saturated_q
        if flags & 2:
            self.velocity_noise += dt * self.acc_saturated_q
        if dt > self.gap_s:
            self.tilt_noise += dt * dt * self.gap_rate_var
            self.velocity_noise += dt * dt * self.gap_acc_var
        self.look_for_rest(dt, wx, wy, wz, ax, ay, az)
        self.dt += dt
        if self.dt + 0.5 * dt >= self.update_s:
            self.correct(r_given, fz)
            self.event = 1

    def take_rate(self) -> None:
        """The last rate without its bias, and without what the scales add."""
        e = self.e
        k = self.scale
        e[0] = self.w[0] - self.b[0]
        e[1] = self.w[1] - self.b[1]
        e[2] = self.w[2] - self.b[2]
        self.g[0] = e[0] - (k[0] * e[0] + k[1] * e[1] + k[2] * e[2])
        self.g[1] = e[1] - (k[3] * e[0] + k[4] * e[1] + k[5] * e[2])
        self.g[2] = e[2] - (k[6] * e[0] + k[7] * e[1] + k[8] * e[2])

    def correct(self, r_given: float, fz: float) -> None:
        """Brings the covariance up to now and takes in that the inertial velocity is zero, give or take r."""
        b = self.b
        self.grow()
        is_rest = self.rest_s >= self.rest_min_s
        # The window: how large the velocity is, beyond what the filter expects of its own error.
        p = self.p
        vx = self.v[0]
        vy = self.v[1]
        self.seen_s += self.dt
        g = min(1.0, self.dt / min(self.seen_s, self.window_s))
        self.mean_y[0] += g * (vx - self.mean_y[0])
        self.mean_y[1] += g * (vy - self.mean_y[1])
        self.mean_yy += g * (vx * vx + vy * vy - self.mean_yy)
        self.hph = p[34] + p[51]
        self.mean_hph += g * (self.hph - self.mean_hph)
        r = 0.5 * (self.mean_yy - self.mean_y[0] * self.mean_y[0] - self.mean_y[1] * self.mean_y[1] - self.mean_hph)
        r = min(max(r, 0.0) + self.r_floor, self.r_largest)
        if self.r_is_constant:
            r = self.r_start
        if r_given >= 0.0:
            r = r_given
        self.r = r
        s = (self.rest_r if is_rest else r * self.r_factor) / self.dt
        self.update_velocity(vx, vy, s)
        if is_rest:
            # At rest the gyro reads its bias. The moment rest is found, the whole time since it began counts.
            s = self.rest_bias_q / (self.dt if self.rest_s - self.dt >= self.rest_min_s else self.rest_s)
            for i in range(3):
                g = b[i] - self.rest_w[i]
                if not self.has_rested:
                    p[17 * (4 + i)] += g * g  # the first rest is believed whatever was thought before
                if g * g <= self.rest_bias_gate + 16.0 * p[17 * (4 + i)]:
                    self.update(4 + i, g, s)
            self.has_rested = True
        self.v[0] = vx - self.d[2]
        self.v[1] = vy - self.d[3]
        b[0] -= self.d[4]
        b[1] -= self.d[5]
        b[2] -= self.d[6]
        for i in range(7, self.end):
            self.scale[i - 7] -= self.d[i]
        self.take_rate()
        self.tilt(-0.5 * self.d[0], -0.5 * self.d[1])
        self.f[0] -= self.d[1] * fz
        self.f[1] += self.d[0] * fz

    def grow(self) -> None:
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
            p[17 * i] += self.dt * self.bias_q

    def integrate(self, dt: float, ux: float, uy: float, uz: float, gx: float, gy: float, gz: float) -> None:
        """Turns the attitude by the mean of the two rates that bound the step, and the coning between them."""
        c = dt * dt / 24.0  # half of dt^2 / 12: a quaternion takes half the angle
        self.turn(
            0.25 * dt * (ux + gx) + c * (uy * gz - uz * gy),
            0.25 * dt * (uy + gy) + c * (uz * gx - ux * gz),
            0.25 * dt * (uz + gz) + c * (ux * gy - uy * gx),
        )

    def take_tilt(self, w: float, x: float, y: float, z: float) -> None:
        """Takes the tilt of another attitude and keeps the own heading."""
        q = self.q
        # the turn about the vertical from the other to this one: the w and z of q (x) other*
        cw = q[0] * w + q[1] * x + q[2] * y + q[3] * z
        cz = q[3] * w - q[0] * z - q[1] * y + q[2] * x
        n = cw * cw + cz * cz
        if n > 0.0:
            n = 1.0 / n**0.5
            cw *= n
            cz *= n
            q[0] = cw * w - cz * z
            q[1] = cw * x - cz * y
            q[2] = cw * y + cz * x
            q[3] = cw * z + cz * w

    def turn(self, hx: float, hy: float, hz: float) -> None:
        """Turns the attitude by twice the half angle h, given on the sensor's axes; exact."""
        q = self.q
        n = 0
        x = hx * hx + hy * hy + hz * hz
        while x > 0.015625:
            x *= 0.25
            hx *= 0.5
            hy *= 0.5
            hz *= 0.5
            n += 1
        # sin(h)/h and cos(h): for h^2 <= 1/64 the next terms are below 1e-16
        s = 1.0 + x * (-1.0 / 6.0 + x * (1.0 / 120.0 + x * (-1.0 / 5040.0 + x * (1.0 / 362880.0))))
        w = 1.0 + x * (-0.5 + x * (1.0 / 24.0 + x * (-1.0 / 720.0 + x * (1.0 / 40320.0 + x * (-1.0 / 3628800.0)))))
        hx *= s
        hy *= s
        hz *= s
        while n > 0:
            s = 2.0 * w
            w = w * w - hx * hx - hy * hy - hz * hz
            hx *= s
            hy *= s
            hz *= s
            n -= 1
        qw = q[0]
        qx = q[1]
        qy = q[2]
        qz = q[3]
        q[0] = qw * w - qx * hx - qy * hy - qz * hz
        q[1] = qw * hx + qx * w + qy * hz - qz * hy
        q[2] = qw * hy - qx * hz + qy * w + qz * hx
        q[3] = qw * hz + qx * hy - qy * hx + qz * w

    def tilt(self, hx: float, hy: float) -> None:
        """Turns the attitude by twice the half angle h about the room's x and y, and normalises it."""
        q = self.q
        n = (1.0 + hx * hx + hy * hy) * (q[0] * q[0] + q[1] * q[1] + q[2] * q[2] + q[3] * q[3])
        if abs(n - 1.0) < 1e-4:
            s = 1.5 - 0.5 * n  # 1/sqrt(n) by two of Newton's steps, for speed
            s *= 1.5 - 0.5 * n * s * s
        else:
            s = n**-0.5
        qw = q[0] * s
        qx = q[1] * s
        qy = q[2] * s
        qz = q[3] * s
        q[0] = qw - hx * qx - hy * qy
        q[1] = qx + hx * qw + hy * qz
        q[2] = qy - hx * qz + hy * qw
        q[3] = qz + hx * qy - hy * qx

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

    def look_for_rest(self, dt: float, wx: float, wy: float, wz: float, ax: float, ay: float, az: float) -> None:
        """Keeps the mean rate and specific force since they last moved, and the time since then."""
        u = self.rest_w
        f = self.rest_a
        if (
            dt > self.gap_s
            or abs(wx - u[0]) > self.rest_rate
            or abs(wy - u[1]) > self.rest_rate
            or abs(wz - u[2]) > self.rest_rate
            or abs(ax - f[0]) > self.rest_acc
            or abs(ay - f[1]) > self.rest_acc
            or abs(az - f[2]) > self.rest_acc
        ):
            self.rest_s = 0.0
            u[0] = wx
            u[1] = wy
            u[2] = wz
            f[0] = ax
            f[1] = ay
            f[2] = az
            return
        self.rest_s += dt
        g = min(1.0, dt / min(self.rest_s + dt, self.rest_min_s))
        u[0] += g * (wx - u[0])
        u[1] += g * (wy - u[1])
        u[2] += g * (wz - u[2])
        f[0] += g * (ax - f[0])
        f[1] += g * (ay - f[1])
        f[2] += g * (az - f[2])

    def run(
        self,
        time_s: memoryview[float],
        gyr: memoryview[float],
        acc: memoryview[float],
        flags: memoryview[int],
        out_q: memoryview[float],
        out_b: memoryview[float],
        out_var: memoryview[float],
        out_r: memoryview[float],
        out_y: memoryview[float],
    ) -> None:
        """Takes all samples, causally.

        `out_var` is the variance of tilt per axis, `out_r` that of the velocity, and `out_y` (n, 3), for
        `centred_r`, the velocity found and the filter's own variance of it, where there was a correction; without
        rows it is left out.
        """
        dt = 0.0
        for n in range(len(time_s)):
            if n > 0:
                dt = time_s[n] - time_s[n - 1]
            self.step(dt, gyr[n, 0], gyr[n, 1], gyr[n, 2], acc[n, 0], acc[n, 1], acc[n, 2], flags[n], -1.0)
            self.write(n, out_q, out_b, out_var, out_r, out_y)

    def write(
        self,
        n: int,
        out_q: memoryview[float],
        out_b: memoryview[float],
        out_var: memoryview[float],
        out_r: memoryview[float],
        out_y: memoryview[float],
    ) -> None:
        """Writes the estimate at row n."""
        for i in range(4):
            out_q[n, i] = self.q[i]
        for i in range(3):
            out_b[n, i] = self.b[i]
        out_var[n] = 0.5 * (self.p[0] + self.p[17])
        out_r[n] = self.r
        if len(out_y) == 0:
            return
        out_y[n, 2] = -1.0
        if self.event == 1:
            out_y[n, 0] = self.v[0] + self.d[2]
            out_y[n, 1] = self.v[1] + self.d[3]
            out_y[n, 2] = self.hph

    def skip(
        self,
        time_s: memoryview[float],
        gyr: memoryview[float],
        acc: memoryview[float],
        flags: memoryview[int],
        r: memoryview[float],
        first: int,
        last: int,
    ) -> None:
        """Takes the samples [first, last) with r given, and writes nothing."""
        dt = 0.0
        for n in range(first, last):
            if n > 0:
                dt = time_s[n] - time_s[n - 1]
            self.step(dt, gyr[n, 0], gyr[n, 1], gyr[n, 2], acc[n, 0], acc[n, 1], acc[n, 2], flags[n], r[n])

    def write_tape(
        self,
        time_s: memoryview[float],
        gyr: memoryview[float],
        acc: memoryview[float],
        flags: memoryview[int],
        r: memoryview[float],
        first: int,
        last: int,
        tape: memoryview[float],
        marks: memoryview[int],
    ) -> int:
        """Takes the samples [first, last) with r given, and writes what the smoother needs; returns the rows written.

        A row is written for each start and each correction. Of the tape, 128 numbers: what tilts and accelerates the
        errors (7), five updates of 10 (gain, y / s, 1 / s), the covariance (56), attitude (4), bias (3). Of the
        marks, 7: the sample, the number of updates or -1 for a start, and which error each update measured.
        """
        n_rows = 0
        dt = 0.0
        for n in range(first, last):
            if n > 0:
                dt = time_s[n] - time_s[n - 1]
            self.step(dt, gyr[n, 0], gyr[n, 1], gyr[n, 2], acc[n, 0], acc[n, 1], acc[n, 2], flags[n], r[n])
            if n == 0:
                self.event = 2
            if self.event == 0:
                continue
            for i in range(3):
                tape[n_rows, i] = self.a[i]
                tape[n_rows, 3 + i] = self.a[12 + i]
            tape[n_rows, 6] = self.c
            marks[n_rows, 0] = n
            marks[n_rows, 1] = self.n_updates if self.event == 1 else -1
            for u in range(self.n_updates):
                for i in range(8):
                    tape[n_rows, 10 + 10 * u + i] = self.k[16 * u + i]
                tape[n_rows, 18 + 10 * u] = self.y[u]
                tape[n_rows, 19 + 10 * u] = self.s[u]
                marks[n_rows, 2 + u] = self.i[u]
            for i in range(7):
                for j in range(8):
                    tape[n_rows, 64 + 8 * i + j] = self.p[16 * i + j] if i < 4 or j > 3 else self.p[16 * j + i]
            for i in range(4):
                tape[n_rows, 120 + i] = self.q[i]
            for i in range(3):
                tape[n_rows, 124 + i] = self.b[i]
            n_rows += 1
        return n_rows


class Smoother:
    """Bryson and Frazier's smoother: runs over the tape backwards; no covariance is inverted."""

    def __init__(self) -> None:
        self.lam = [0.0] * 8
        self.big = [0.0] * 56

    def run(
        self,
        tape: memoryview[float],
        marks: memoryview[int],
        n_rows: int,
        out_q: memoryview[float],
        out_b: memoryview[float],
        out_var: memoryview[float],
    ) -> None:
        """Writes smoothed attitude (but for its heading), bias and tilt variance of the tape's samples."""
        x = [0.0] * 8
        q = [0.0] * 4
        for row in range(n_rows - 1, -1, -1):
            n = marks[row, 0]
            # What is left of the error, x = -P lam, and its variance, P - P Lam P, for the two tilts.
            for i in range(7):
                x[i] = 0.0
                for j in range(7):
                    x[i] -= tape[row, 64 + 8 * i + j] * self.lam[j]
            for i in range(4):
                q[i] = tape[row, 120 + i]
            hx = -0.5 * x[0]
            hy = -0.5 * x[1]
            # the turn takes the direction of (1, hx, hy): tan of the half angle for the angle itself, small here
            s = 1.0 / (1.0 + hx * hx + hy * hy) ** 0.5
            out_q[n, 0] = s * (q[0] - hx * q[1] - hy * q[2])
            out_q[n, 1] = s * (q[1] + hx * q[0] + hy * q[3])
            out_q[n, 2] = s * (q[2] - hx * q[3] + hy * q[0])
            out_q[n, 3] = s * (q[3] + hx * q[2] - hy * q[1])
            for i in range(3):
                out_b[n, i] = tape[row, 124 + i] - x[4 + i]
            s = tape[row, 64] + tape[row, 73]
            for i in range(7):
                hx = 0.0
                hy = 0.0
                for j in range(7):
                    hx += self.big[8 * i + j] * tape[row, 64 + j]
                    hy += self.big[8 * i + j] * tape[row, 72 + j]
                s -= hx * tape[row, 64 + i] + hy * tape[row, 72 + i]
            out_var[n] = 0.5 * s
            self.step_back(tape, marks, row)

    def step_back(self, tape: memoryview[float], marks: memoryview[int], row: int) -> None:
        """From after a correction to after the one before it."""
        lam = self.lam
        big = self.big
        w = [0.0] * 8
        n_updates = marks[row, 1]
        if n_updates < 0:  # a start: tilt and velocity owe nothing to what was before
            for i in range(4):
                lam[i] = 0.0
                for j in range(8):
                    big[8 * i + j] = 0.0
            for i in range(4, 7):
                for j in range(4):
                    big[8 * i + j] = 0.0
            return
        for u in range(n_updates - 1, -1, -1):
            at = 10 + 10 * u
            m = marks[row, 2 + u]
            s = 0.0
            for j in range(7):
                s += tape[row, at + j] * lam[j]
            lam[m] -= s + tape[row, at + 8]
            s = 0.0
            for i in range(7):
                w[i] = 0.0
                for j in range(7):
                    w[i] += big[8 * i + j] * tape[row, at + j]
                s += w[i] * tape[row, at + i]
            for j in range(7):
                big[8 * m + j] -= w[j]
                big[8 * j + m] -= w[j]
            big[9 * m] += s + tape[row, at + 9]
        # lam = F' lam and Lam = F' Lam F, F being velocity after tilt after bias
        c = tape[row, 6]
        lam[0] -= c * lam[3]
        lam[1] += c * lam[2]
        for j in range(8):
            big[j] -= c * big[24 + j]
            big[8 + j] += c * big[16 + j]
        for i in range(7):
            big[8 * i] -= c * big[8 * i + 3]
            big[8 * i + 1] += c * big[8 * i + 2]
        for m in range(3):
            lam[4 + m] += tape[row, m] * lam[0] + tape[row, 3 + m] * lam[1]
            for j in range(8):
                big[8 * (4 + m) + j] += tape[row, m] * big[j] + tape[row, 3 + m] * big[8 + j]
        for i in range(7):
            for m in range(3):
                big[8 * i + 4 + m] += tape[row, m] * big[8 * i] + tape[row, 3 + m] * big[8 * i + 1]


def fill(
    time_s: memoryview[float],
    gyr: memoryview[float],
    is_row: memoryview[int],
    out_q: memoryview[float],
    out_b: memoryview[float],
    out_var: memoryview[float],
) -> None:
    """Between the smoothed samples the gyro, less the smoothed bias, tells the attitude; and all the heading."""
    turner = AttitudeFilter()
    for i in range(4):
        turner.q[i] = out_q[0, i]
    for n in range(1, len(time_s)):
        turner.integrate(
            time_s[n] - time_s[n - 1],
            gyr[n - 1, 0] - out_b[n - 1, 0],
            gyr[n - 1, 1] - out_b[n - 1, 1],
            gyr[n - 1, 2] - out_b[n - 1, 2],
            gyr[n, 0] - out_b[n - 1, 0],
            gyr[n, 1] - out_b[n - 1, 1],
            gyr[n, 2] - out_b[n - 1, 2],
        )
        if is_row[n]:
            turner.take_tilt(out_q[n, 0], out_q[n, 1], out_q[n, 2], out_q[n, 3])
        else:
            for i in range(3):
                out_b[n, i] = out_b[n - 1, i]
            out_var[n] = out_var[n - 1]
        for i in range(4):
            out_q[n, i] = turner.q[i]


def finish(
    gyr: memoryview[float],
    b: memoryview[float],
    delay_s: float,
    unseen_var: float,
    delay_var: float,
    out_q: memoryview[float],
    out_sd: memoryview[float],
) -> None:
    """Turns each attitude on by what its rate does in the gyro's delay, and the variance of tilt into a deviation.

    To it come `unseen_var` (rad^2) and `delay_var` (s^2), the doubt about the delay, times the rate squared.
    """
    for n in range(len(gyr)):
        hx = gyr[n, 0] - b[n, 0]
        hy = gyr[n, 1] - b[n, 1]
        hz = gyr[n, 2] - b[n, 2]
        s = hx * hx + hy * hy + hz * hz
        out_sd[n] = math.sqrt(max(out_sd[n], 0.0) + unseen_var + delay_var * s)
        if delay_s != 0.0:
            c = 0.5 * delay_s
            hx *= c
            hy *= c
            hz *= c
            s *= c * c
            s = 1.0 - s * (0.5 - s * (0.375 - s * 0.3125))  # 1/sqrt(1 + s) for a small turn
            qw = out_q[n, 0] * s
            qx = out_q[n, 1] * s
            qy = out_q[n, 2] * s
            qz = out_q[n, 3] * s
            out_q[n, 0] = qw - qx * hx - qy * hy - qz * hz
            out_q[n, 1] = qw * hx + qx + qy * hz - qz * hy
            out_q[n, 2] = qw * hy - qx * hz + qy + qz * hx
            out_q[n, 3] = qw * hz + qx * hy - qy * hx + qz


def centred_r(
    time_s: memoryview[float],
    y: memoryview[float],
    window_s: float,
    floor: float,
    largest: float,
    r: memoryview[float],
) -> None:
    """Turns `r` of the past into the mean of the windows over past and future; `y` is `run`'s."""
    mean_x = 0.0
    mean_y = 0.0
    mean_yy = 0.0
    mean_hph = 0.0
    seen_s = 0.0
    future = -1.0
    after = len(time_s) - 1
    for n in range(len(time_s) - 1, -1, -1):
        if y[n, 2] >= 0.0:
            seen_s += time_s[after] - time_s[n]
            g = min(1.0, (time_s[after] - time_s[n]) / min(seen_s, window_s)) if seen_s > 0.0 else 1.0
            after = n
            mean_x += g * (y[n, 0] - mean_x)
            mean_y += g * (y[n, 1] - mean_y)
            mean_yy += g * (y[n, 0] * y[n, 0] + y[n, 1] * y[n, 1] - mean_yy)
            mean_hph += g * (y[n, 2] - mean_hph)
            future = max(0.5 * (mean_yy - mean_x * mean_x - mean_y * mean_y - mean_hph), 0.0) + floor
            future = min(future, largest)
        if future >= 0.0:
            r[n] = 0.5 * (r[n] + future)
