"""Smoothing of an attitude: plain Python that Cython compiles, as `_attitude_kernel.py`, whose tape it reads."""

from __future__ import annotations

import math

from inhalemon._attitude_kernel import AttitudeFilter


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
            s = 1.0 / math.sqrt(1.0 + hx * hx + hy * hy)
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
