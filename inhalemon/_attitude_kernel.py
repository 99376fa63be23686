"""The attitude filter, sample by sample: plain Python that Cython compiles when there is a C compiler.

`_attitude_kernel.pxd` gives the C types; both forms do the same operations in the same order, so their results are
the same to the bit. What the filter does and why is told in `stages/attitude.py` and docs/method.md.

The error state, always estimate less truth, is
    0, 1  tilt about the room's x and y (rad)
    2, 3  horizontal velocity in the room (m/s)
    4, 5, 6  gyro bias on the sensor's axes (rad/s)
and its covariance is kept as 7 rows of 8 (the last column is padding: rows of 8 vectorise).
"""

from __future__ import annotations


class AttitudeFilter:
    """A filter's numbers and its state. Fields ending in `_q` are spectral densities of a noise.

    `step` takes one sample; `run` takes many and writes what came out. Both leave the state after the last sample.
    """

    def __init__(self) -> None:
        # the numbers of AttitudeSettings, in the form the filter uses
        self.gyr_q = 0.0  # rad^2/s
        self.rate_q = 0.0  # s: angle variance grows by rate_q |w|^2 per second
        self.bias_q = 0.0  # rad^2/s^3
        self.acc_q = 0.0  # m^2/s^3
        self.gyr_saturated_q = 0.0  # rad^2/s
        self.acc_saturated_q = 0.0  # m^2/s^3
        self.gap_s = 0.0
        self.reset_gap_s = 0.0
        self.gap_rate_var = 0.0  # rad^2/s^2
        self.gap_acc_var = 0.0  # m^2/s^4
        self.tilt_var = 0.0  # rad^2, at the start
        self.velocity_var = 0.0  # m^2/s^2, at the start
        self.bias_var = 0.0  # rad^2/s^2, at the start
        self.r_factor = 0.0  # s: the measurement's density is r_factor times the velocity's variance
        self.r_start = 0.0  # m^2/s^2
        self.r_floor = 0.0  # m^2/s^2
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
        self.q = [1.0, 0.0, 0.0, 0.0]
        self.b = [0.0] * 3
        self.v = [0.0] * 2
        self.p = [0.0] * 56
        self.w = [0.0] * 3  # the last rate as it was read
        self.f = [0.0] * 2  # the last horizontal specific force in the room
        self.mean_y = [0.0] * 2
        self.mean_yy = 0.0
        self.mean_hph = 0.0
        self.seen_s = 0.0
        self.rest_w = [0.0] * 3
        self.rest_a = [0.0] * 3
        self.rest_s = 0.0
        # of the sample just taken, for the tape
        self.r = 0.0  # m^2/s^2, the velocity's variance as the window shows it
        self.d = [0.0] * 8
        self.a = [0.0] * 6
        self.c = 0.0
        self.n_updates = 0
        self.k = [0.0] * 40
        self.y = [0.0] * 5
        self.s = [0.0] * 5

    def start(self, ax: float, ay: float, az: float) -> None:
        """Takes the tilt from one reading of specific force and forgets the velocity; heading and bias stay."""
        q = self.q
        p = self.p
        if not self.is_started:
            for i in range(4, 7):
                p[8 * i + i] = self.bias_var
            self.is_started = True
        # the specific force as the present attitude sees it in the room, and the smallest turn that brings it upright
        fx, fy, fz = 0.0, 0.0, 0.0
        fx = (1.0 - 2.0 * (q[2] * q[2] + q[3] * q[3])) * ax + 2.0 * (
            (q[1] * q[2] - q[0] * q[3]) * ay + (q[1] * q[3] + q[0] * q[2]) * az
        )
        fy = (1.0 - 2.0 * (q[1] * q[1] + q[3] * q[3])) * ay + 2.0 * (
            (q[1] * q[2] + q[0] * q[3]) * ax + (q[2] * q[3] - q[0] * q[1]) * az
        )
        fz = (1.0 - 2.0 * (q[1] * q[1] + q[2] * q[2])) * az + 2.0 * (
            (q[1] * q[3] - q[0] * q[2]) * ax + (q[2] * q[3] + q[0] * q[1]) * ay
        )
        n = (fx * fx + fy * fy + fz * fz) ** 0.5
        if n > 0.0:
            cw = n + fz
            cx = fy
            cy = -fx
            if cw < 1e-9 * n:  # upside down: half a turn about x
                cw, cx, cy = 0.0, 1.0, 0.0
            n = (cw * cw + cx * cx + cy * cy) ** 0.5
            cw /= n
            cx /= n
            cy /= n
            qw, qx, qy, qz = q[0], q[1], q[2], q[3]
            q[0] = cw * qw - cx * qx - cy * qy
            q[1] = cw * qx + cx * qw + cy * qz
            q[2] = cw * qy - cx * qz + cy * qw
            q[3] = cw * qz + cx * qy - cy * qx
        for i in range(4):
            for j in range(7):
                p[8 * i + j] = 0.0
                p[8 * j + i] = 0.0
        p[0] = self.tilt_var
        p[9] = self.tilt_var
        p[18] = self.velocity_var
        p[27] = self.velocity_var
        self.v[0] = 0.0
        self.v[1] = 0.0
        self.f[0] = 0.0
        self.f[1] = 0.0
        self.mean_y[0] = 0.0
        self.mean_y[1] = 0.0
        self.mean_yy = self.r_start
        self.mean_hph = 0.0
        self.seen_s = 0.0
        self.rest_s = 0.0
        self.r = self.r_start
        self.n_updates = 0

    def step(
        self, dt: float, wx: float, wy: float, wz: float, ax: float, ay: float, az: float, flags: int, r_given: float
    ) -> None:
        """Takes the sample that comes `dt` after the last one (the first one: `dt` does not matter).

        `r_given` is the velocity's variance to use; negative: from the window over the past.
        """
        q = self.q
        b = self.b
        p = self.p
        if not self.is_started or dt > self.reset_gap_s:
            self.start(ax, ay, az)
            self.w[0] = wx
            self.w[1] = wy
            self.w[2] = wz
            for i in range(6):
                self.a[i] = 0.0
            self.c = 0.0
            return
        # 1. The attitude turns by the mean of the two rates that bound the step, coning between them included.
        ux = self.w[0] - b[0]
        uy = self.w[1] - b[1]
        uz = self.w[2] - b[2]
        gx = wx - b[0]
        gy = wy - b[1]
        gz = wz - b[2]
        c = dt * dt / 24.0  # half of dt^2 / 12: the quaternion takes half the angle
        hx = 0.25 * dt * (ux + gx) + c * (uy * gz - uz * gy)
        hy = 0.25 * dt * (uy + gy) + c * (uz * gx - ux * gz)
        hz = 0.25 * dt * (uz + gz) + c * (ux * gy - uy * gx)
        rate2 = 0.5 * (ux * ux + uy * uy + uz * uz + gx * gx + gy * gy + gz * gz)
        self.w[0] = wx
        self.w[1] = wy
        self.w[2] = wz
        self.turn(hx, hy, hz)
        # 2. Specific force in the room.
        r00 = 1.0 - 2.0 * (q[2] * q[2] + q[3] * q[3])
        r01 = 2.0 * (q[1] * q[2] - q[0] * q[3])
        r02 = 2.0 * (q[1] * q[3] + q[0] * q[2])
        r10 = 2.0 * (q[1] * q[2] + q[0] * q[3])
        r11 = 1.0 - 2.0 * (q[1] * q[1] + q[3] * q[3])
        r12 = 2.0 * (q[2] * q[3] - q[0] * q[1])
        fx = r00 * ax + r01 * ay + r02 * az
        fy = r10 * ax + r11 * ay + r12 * az
        fz = (
            2.0 * ((q[1] * q[3] - q[0] * q[2]) * ax + (q[2] * q[3] + q[0] * q[1]) * ay)
            + (1.0 - 2.0 * (q[1] * q[1] + q[2] * q[2])) * az
        )
        self.v[0] += 0.5 * dt * (self.f[0] + fx)
        self.v[1] += 0.5 * dt * (self.f[1] + fy)
        # 3. The covariance of the error: the bias tilts, the tilt accelerates.
        a0 = -dt * r00
        a1 = -dt * r01
        a2 = -dt * r02
        a3 = -dt * r10
        a4 = -dt * r11
        a5 = -dt * r12
        c = dt * fz
        tilt_var = dt * (self.gyr_q + self.rate_q * rate2)
        velocity_var = dt * self.acc_q
        if flags & 1:
            tilt_var += dt * self.gyr_saturated_q
        if flags & 2:
            velocity_var += dt * self.acc_saturated_q
        if dt > self.gap_s:
            tilt_var += dt * dt * self.gap_rate_var
            velocity_var += dt * dt * self.gap_acc_var
        for j in range(8):
            p[j] += a0 * p[32 + j] + a1 * p[40 + j] + a2 * p[48 + j]
            p[8 + j] += a3 * p[32 + j] + a4 * p[40 + j] + a5 * p[48 + j]
        p[0] += a0 * p[4] + a1 * p[5] + a2 * p[6] + tilt_var
        p[1] += a3 * p[4] + a4 * p[5] + a5 * p[6]
        p[9] += a3 * p[12] + a4 * p[13] + a5 * p[14] + tilt_var
        p[8] = p[1]
        for i in range(2, 7):
            p[8 * i] = p[i]
            p[8 * i + 1] = p[8 + i]
        for j in range(8):
            p[16 + j] += c * p[8 + j]
            p[24 + j] -= c * p[j]
        p[18] += c * p[17] + velocity_var
        p[19] -= c * p[16]
        p[27] -= c * p[24] - velocity_var
        p[26] = p[19]
        p[2] = p[16]
        p[10] = p[17]
        p[3] = p[24]
        p[11] = p[25]
        for i in range(4, 7):
            p[8 * i + 2] = p[16 + i]
            p[8 * i + 3] = p[24 + i]
            p[9 * i] += dt * self.bias_q
        self.a[0] = a0
        self.a[1] = a1
        self.a[2] = a2
        self.a[3] = a3
        self.a[4] = a4
        self.a[5] = a5
        self.c = c
        # 4. Is it at rest? The means since the last disturbance, and how long ago that was.
        was_rest_s = self.rest_s
        self.look_for_rest(dt, wx, wy, wz, ax, ay, az)
        is_rest = self.rest_s >= self.rest_min_s
        # 5. The window: how large the velocity is, beyond what the filter expects of its own error.
        vx = self.v[0]
        vy = self.v[1]
        self.seen_s += dt
        g = min(1.0, dt / min(self.seen_s, self.window_s))
        self.mean_y[0] += g * (vx - self.mean_y[0])
        self.mean_y[1] += g * (vy - self.mean_y[1])
        self.mean_yy += g * (vx * vx + vy * vy - self.mean_yy)
        self.mean_hph += g * (p[18] + p[27] - self.mean_hph)
        r = 0.0
        if r_given >= 0.0:
            r = r_given
        elif self.r_is_constant:
            r = self.r_start
        else:
            r = 0.5 * (self.mean_yy - self.mean_y[0] * self.mean_y[0] - self.mean_y[1] * self.mean_y[1] - self.mean_hph)
            r = max(r, 0.0) + self.r_floor
        self.r = r
        # 6. The inertial velocity is zero, give or take r.
        for i in range(8):
            self.d[i] = 0.0
        self.n_updates = 0
        s = self.rest_r / dt if is_rest else r * self.r_factor / dt
        self.update(2, vx, s)
        self.update(3, vy, s)
        if is_rest:
            # At rest the gyro reads its bias. The moment rest is found, the whole time since it began counts.
            s = self.rest_bias_q / (dt if was_rest_s >= self.rest_min_s else self.rest_s)
            for i in range(3):
                g = b[i] - self.rest_w[i]
                if g * g <= self.rest_bias_gate + 16.0 * p[9 * (4 + i)]:
                    self.update(4 + i, g, s)
        # 7. The estimate takes the correction.
        self.v[0] = vx - self.d[2]
        self.v[1] = vy - self.d[3]
        b[0] -= self.d[4]
        b[1] -= self.d[5]
        b[2] -= self.d[6]
        self.tilt(-0.5 * self.d[0], -0.5 * self.d[1])
        self.f[0] = fx - self.d[1] * fz
        self.f[1] = fy + self.d[0] * fz

    def turn(self, hx: float, hy: float, hz: float) -> None:
        """Turns the attitude by twice the half angle h, given on the sensor's axes; exact."""
        q = self.q
        n = 0
        x = hx * hx + hy * hy + hz * hz
        while x > 0.0625:
            x *= 0.25
            hx *= 0.5
            hy *= 0.5
            hz *= 0.5
            n += 1
        # sin(h)/h and cos(h): for h^2 <= 1/16 the next terms are below 1e-17
        s = 1.0 + x * (-1.0 / 6.0 + x * (1.0 / 120.0 + x * (-1.0 / 5040.0 + x * (1.0 / 362880.0 - x / 39916800.0))))
        w = 1.0 + x * (
            -0.5
            + x * (1.0 / 24.0 + x * (-1.0 / 720.0 + x * (1.0 / 40320.0 + x * (-1.0 / 3628800.0 + x / 479001600.0))))
        )
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
        qw, qx, qy, qz = q[0], q[1], q[2], q[3]
        q[0] = qw * w - qx * hx - qy * hy - qz * hz
        q[1] = qw * hx + qx * w + qy * hz - qz * hy
        q[2] = qw * hy - qx * hz + qy * w + qz * hx
        q[3] = qw * hz + qx * hy - qy * hx + qz * w

    def tilt(self, hx: float, hy: float) -> None:
        """Turns the room under the attitude by twice the half angle h about the room's x and y, and normalises."""
        q = self.q
        n = (1.0 + hx * hx + hy * hy) * (q[0] * q[0] + q[1] * q[1] + q[2] * q[2] + q[3] * q[3])
        # 1/sqrt(n): a Newton step is enough as long as n is near one
        s = 1.5 - 0.5 * n if n - 1.0 < 1e-5 else 1.0 / n**0.5
        qw, qx, qy, qz = q[0], q[1], q[2], q[3]
        q[0] = s * (qw - hx * qx - hy * qy)
        q[1] = s * (qx + hx * qw + hy * qz)
        q[2] = s * (qy - hx * qz + hy * qw)
        q[3] = s * (qz + hx * qy - hy * qx)

    def update(self, i: int, error: float, var: float) -> None:
        """One scalar measurement of error i, with its variance."""
        p = self.p
        n = 8 * self.n_updates
        y = error - self.d[i]
        s = 1.0 / (p[9 * i] + var)
        h = [0.0] * 8
        for j in range(8):
            h[j] = p[8 * i + j]
            self.k[n + j] = h[j] * s
            self.d[j] += h[j] * s * y
        for j in range(7):
            for m in range(8):
                p[8 * j + m] -= h[j] * h[m] * s
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
    ) -> None:
        """Takes all samples, causally; `out_var` is the variance of tilt per axis, `out_r` that of the velocity."""
        dt = 0.0
        for n in range(len(time_s)):
            if n > 0:
                dt = time_s[n] - time_s[n - 1]
            self.step(dt, gyr[n, 0], gyr[n, 1], gyr[n, 2], acc[n, 0], acc[n, 1], acc[n, 2], flags[n], -1.0)
            for i in range(4):
                out_q[n, i] = self.q[i]
            for i in range(3):
                out_b[n, i] = self.b[i]
            out_var[n] = 0.5 * (self.p[0] + self.p[9])
            out_r[n] = self.r
