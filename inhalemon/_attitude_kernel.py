"""The attitude filter, sample by sample: plain Python that Cython compiles when there is a C compiler.

`_attitude_kernel.pxd` gives the C types; both forms do the same operations in the same order, so their results are
the same to the bit. What the filter does and why is told in `stages/attitude.py` and docs/method.md.

`step` takes a sample; its arithmetic is all here, since a call into another module costs more than a tenth of it. What
is done every tenth of a second is in `_errors_kernel.py`, smoothing in `_smoother_kernel.py`.
"""

from __future__ import annotations

import math

from inhalemon._errors_kernel import Errors


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
        self.errors = Errors()
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
        self.event = 0  # of the last sample: nothing, corrected, started

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
        n = math.sqrt(fx * fx + fy * fy + fz * fz)
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
        n = math.sqrt(cw * cw + cx * cx + cy * cy)
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
        errors = self.errors
        p = errors.p
        for i in range(64):
            p[i] = 0.0
        if not self.is_started:
            for i in range(64, 256):
                p[i] = 0.0
            for i in range(4, 7):
                p[17 * i] = self.bias_var
            for i in range(7, errors.end):
                p[17 * i] = self.scale_var
        p[0] = self.tilt_var
        p[17] = self.tilt_var
        p[34] = self.velocity_var
        p[51] = self.velocity_var
        for i in range(2):
            self.v[i] = 0.0
            self.f[i] = 0.0
            self.mean_y[i] = 0.0
        errors.gather()
        errors.n_updates = 0
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
        self.errors.take(other.errors)
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
        self.event = other.event

    def step(
        self, dt: float, wx: float, wy: float, wz: float, ax: float, ay: float, az: float, flags: int, r_given: float
    ) -> None:
        """Takes the sample that comes `dt` after the last one (of the first, `dt` does not matter).

        `flags` has bit 1 for a saturated rate, bit 2 for saturated specific force. `r_given` is the velocity's
        variance to use; negative: from the window over the past.
        """
        q = self.q
        errors = self.errors
        a = errors.a
        e = self.e
        g = self.g
        if self.event != 0:  # the last sample closed an interval; its numbers stood until now for who wanted them
            errors.gather()
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
            if self.rest_s >= self.rest_min_s:  # the gyro reads its bias, whatever was thought before
                self.has_rested = True
                for i in range(3):
                    self.b[i] = self.rest_w[i]
                    errors.p[17 * (4 + i)] = self.rest_bias_q / self.rest_s
                self.take_rate()
            c = self.tilt_var / (1.0 + self.tilt_var * 48.0 * self.started_s * self.started_s / self.velocity_var)
            errors.p[0] = c
            errors.p[17] = c
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
        if errors.end > 8:
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
        errors.c += dt * fz  # tilt accelerates
        errors.tilt_noise += dt * (self.gyr_q + self.rate_q * (gx * gx + gy * gy + gz * gz))
        errors.velocity_noise += dt * self.acc_q
        if flags & 1:
            errors.tilt_noise += dt * self.gyr_saturated_q
        if flags & 2:
            errors.velocity_noise += dt * self.acc_saturated_q
        if dt > self.gap_s:
            errors.tilt_noise += dt * dt * self.gap_rate_var
            errors.velocity_noise += dt * dt * self.gap_acc_var
        self.look_for_rest(dt, wx, wy, wz, ax, ay, az)
        errors.dt += dt
        if errors.dt + 0.5 * dt >= self.update_s:
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
        errors = self.errors
        errors.grow(self.bias_q)
        is_rest = self.rest_s >= self.rest_min_s
        # The window: how large the velocity is, beyond what the filter expects of its own error.
        p = errors.p
        vx = self.v[0]
        vy = self.v[1]
        self.seen_s += errors.dt
        g = min(1.0, errors.dt / min(self.seen_s, self.window_s))
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
        s = (self.rest_r if is_rest else r * self.r_factor) / errors.dt
        errors.update_velocity(vx, vy, s)
        if is_rest:
            # At rest the gyro reads its bias. The moment rest is found, the whole time since it began counts.
            s = self.rest_bias_q / (errors.dt if self.rest_s - errors.dt >= self.rest_min_s else self.rest_s)
            for i in range(3):
                g = b[i] - self.rest_w[i]
                if not self.has_rested:
                    p[17 * (4 + i)] += g * g  # the first rest is believed whatever was thought before
                if g * g <= self.rest_bias_gate + 16.0 * p[17 * (4 + i)]:
                    errors.update(4 + i, g, s)
            self.has_rested = True
        self.v[0] = vx - errors.d[2]
        self.v[1] = vy - errors.d[3]
        b[0] -= errors.d[4]
        b[1] -= errors.d[5]
        b[2] -= errors.d[6]
        for i in range(7, errors.end):
            self.scale[i - 7] -= errors.d[i]
        self.take_rate()
        self.tilt(-0.5 * errors.d[0], -0.5 * errors.d[1])
        self.f[0] -= errors.d[1] * fz
        self.f[1] += errors.d[0] * fz

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
            n = 1.0 / math.sqrt(n)
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
            s = 1.0 / math.sqrt(n)
        qw = q[0] * s
        qx = q[1] * s
        qy = q[2] * s
        qz = q[3] * s
        q[0] = qw - hx * qx - hy * qy
        q[1] = qx + hx * qw + hy * qz
        q[2] = qy - hx * qz + hy * qw
        q[3] = qz + hx * qy - hy * qx

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
        out_var[n] = 0.5 * (self.errors.p[0] + self.errors.p[17])
        out_r[n] = self.r
        if len(out_y) == 0:
            return
        out_y[n, 2] = -1.0
        if self.event == 1:
            out_y[n, 0] = self.v[0] + self.errors.d[2]
            out_y[n, 1] = self.v[1] + self.errors.d[3]
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
        errors = self.errors
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
                tape[n_rows, i] = errors.a[i]
                tape[n_rows, 3 + i] = errors.a[12 + i]
            tape[n_rows, 6] = errors.c
            marks[n_rows, 0] = n
            marks[n_rows, 1] = errors.n_updates if self.event == 1 else -1
            for u in range(errors.n_updates):
                for i in range(8):
                    tape[n_rows, 10 + 10 * u + i] = errors.k[16 * u + i]
                tape[n_rows, 18 + 10 * u] = errors.y[u]
                tape[n_rows, 19 + 10 * u] = errors.s[u]
                marks[n_rows, 2 + u] = errors.i[u]
            for i in range(7):
                for j in range(8):
                    tape[n_rows, 64 + 8 * i + j] = errors.p[16 * i + j] if i < 4 or j > 3 else errors.p[16 * j + i]
            for i in range(4):
                tape[n_rows, 120 + i] = self.q[i]
            for i in range(3):
                tape[n_rows, 124 + i] = self.b[i]
            n_rows += 1
        return n_rows
