# C types for _attitude_kernel.py; it is the same program without them.
cimport cython

@cython.final
cdef class AttitudeFilter:
    cdef public double gyr_q, rate_q, bias_q, acc_q, gyr_saturated_q, acc_saturated_q
    cdef public double gap_s, reset_gap_s, gap_rate_var, gap_acc_var
    cdef public double tilt_var, velocity_var, bias_var
    cdef public double r_factor, r_start, r_floor, window_s
    cdef public bint r_is_constant
    cdef public double rest_rate, rest_acc, rest_min_s, rest_bias_q, rest_bias_gate, rest_r
    cdef public bint is_started
    cdef public double[4] q
    cdef public double[3] b
    cdef public double[2] v
    cdef public double[56] p
    cdef double[3] w
    cdef double[2] f
    cdef double[2] mean_y
    cdef double mean_yy, mean_hph, seen_s
    cdef double[3] rest_w
    cdef double[3] rest_a
    cdef public double rest_s, r
    cdef double[8] d
    cdef double[6] a
    cdef double c
    cdef int n_updates
    cdef double[40] k
    cdef double[5] y
    cdef double[5] s

    @cython.locals(
        i=cython.int, j=cython.int, q=cython.p_double, p=cython.p_double,
        fx=double, fy=double, fz=double, n=double, cw=double, cx=double, cy=double,
        qw=double, qx=double, qy=double, qz=double)
    cpdef void start(self, double ax, double ay, double az) noexcept

    @cython.locals(
        i=cython.int, j=cython.int, q=cython.p_double, b=cython.p_double, p=cython.p_double,
        ux=double, uy=double, uz=double, gx=double, gy=double, gz=double, c=double, hx=double, hy=double, hz=double,
        rate2=double, r00=double, r01=double, r02=double, r10=double, r11=double, r12=double, fx=double, fy=double,
        fz=double, a0=double, a1=double, a2=double, a3=double, a4=double, a5=double, tilt_var=double,
        velocity_var=double, was_rest_s=double, is_rest=cython.bint, vx=double, vy=double, g=double, r=double, s=double)
    cpdef void step(
        self, double dt, double wx, double wy, double wz, double ax, double ay, double az, int flags, double r_given
    ) noexcept

    @cython.locals(
        n=cython.int, q=cython.p_double, x=double, s=double, w=double, qw=double, qx=double, qy=double, qz=double)
    cdef void turn(self, double hx, double hy, double hz) noexcept

    @cython.locals(q=cython.p_double, n=double, s=double, qw=double, qx=double, qy=double, qz=double)
    cdef void tilt(self, double hx, double hy) noexcept

    @cython.locals(p=cython.p_double, n=cython.int, j=cython.int, m=cython.int, y=double, s=double, h="double[8]")
    cdef void update(self, int i, double error, double var) noexcept

    @cython.locals(u=cython.p_double, f=cython.p_double, g=double)
    cdef void look_for_rest(
        self, double dt, double wx, double wy, double wz, double ax, double ay, double az) noexcept

    @cython.locals(n=cython.Py_ssize_t, i=cython.int, dt=double)
    cpdef void run(
        self, const double[::1] time_s, const double[:, ::1] gyr, const double[:, ::1] acc, const unsigned char[::1] flags,
        double[:, ::1] out_q, double[:, ::1] out_b, double[::1] out_var, double[::1] out_r)
