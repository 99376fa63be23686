# C types for _attitude_kernel.py; it is the same program without them.
# Indices are Py_ssize_t: with a narrower type the compiler cannot turn the loops into vector instructions.
cimport cython
from libc cimport math
from inhalemon._errors_kernel cimport Errors

@cython.final
cdef class AttitudeFilter:
    cdef public double update_s, gyr_delay_s, gyr_q, rate_q, bias_q, acc_q, clip_rate, clip_acc, gyr_saturated_q, acc_saturated_q
    cdef double started_s
    cdef double[3] start_f
    cdef public double start_s, gap_s, reset_gap_s, gap_rate_var, gap_acc_var
    cdef public double tilt_var, velocity_var, bias_var, scale_var
    cdef public double r_factor, r_start, r_start_s, r_floor, r_largest, window_s
    cdef public bint r_is_constant
    cdef public double rest_rate, rest_acc, rest_min_s, rest_bias_q, rest_bias_gate, rest_r
    cdef public bint is_started, has_rested
    cdef public double[4] q
    cdef public double[3] b
    cdef public double[9] scale
    cdef public double[2] v
    cdef readonly Errors errors
    cdef double[3] w
    cdef double[3] e
    cdef double[3] g
    cdef double[3] acc
    cdef double largest_rate, largest_acc
    cdef int gyr_same, acc_same
    cdef double[2] f
    cdef double[2] mean_y
    cdef double mean_yy, mean_hph, hph, seen_s
    cdef double[3] rest_w
    cdef double[3] rest_a
    cdef public double rest_s, r
    cdef int event

    @cython.locals(
        q=cython.p_double, m=cython.p_double, g=double, fx=double, fy=double, fz=double, n=double, cw=double, cx=double, cy=double,
        qw=double, qx=double, qy=double, qz=double)
    cdef void start(self, double dt, double ax, double ay, double az) noexcept

    @cython.locals(errors=Errors, p=cython.p_double, i=cython.Py_ssize_t)
    cpdef void begin(self) noexcept

    @cython.locals(i=cython.Py_ssize_t)
    cpdef void take(self, AttitudeFilter other) noexcept

    @cython.locals(
        errors=Errors, q=cython.p_double, a=cython.p_double, e=cython.p_double, g=cython.p_double, c=double, hx=double, hy=double,
        hz=double, ux=double, uy=double, uz=double, gx=double, gy=double, gz=double,
        r00=double, r01=double, r02=double, r10=double, r11=double, r12=double, fx=double, fy=double, fz=double,
        i=cython.Py_ssize_t)
    cpdef void step(
        self, double dt, double wx, double wy, double wz, double ax, double ay, double az, int flags, double r_given
    ) noexcept

    @cython.locals(
        errors=Errors, b=cython.p_double, p=cython.p_double, is_rest=cython.bint, vx=double, vy=double, g=double, r=double, s=double,
        i=cython.Py_ssize_t)
    cdef void correct(self, double r_given, double fz) noexcept

    @cython.locals(e=cython.p_double, k=cython.p_double)
    cdef inline void take_rate(self) noexcept

    @cython.locals(c=double)
    cdef inline void integrate(self, double dt, double ux, double uy, double uz, double gx, double gy, double gz) noexcept

    @cython.locals(q=cython.p_double, cw=double, cz=double, n=double)
    cdef void take_tilt(self, double w, double x, double y, double z) noexcept

    @cython.locals(
        q=cython.p_double, n=cython.Py_ssize_t, x=double, s=double, w=double, qw=double, qx=double, qy=double, qz=double)
    cdef inline void turn(self, double hx, double hy, double hz) noexcept

    @cython.locals(q=cython.p_double, n=double, s=double, qw=double, qx=double, qy=double, qz=double)
    cdef void tilt(self, double hx, double hy) noexcept

    @cython.locals(u=cython.p_double, f=cython.p_double, g=double)
    cdef inline void look_for_rest(
        self, double dt, double wx, double wy, double wz, double ax, double ay, double az) noexcept

    @cython.locals(n=cython.Py_ssize_t, i=cython.Py_ssize_t, dt=double)
    cpdef void run(
        self, const double[::1] time_s, const double[:, ::1] gyr, const double[:, ::1] acc,
        const unsigned char[::1] flags, double[:, ::1] out_q, double[:, ::1] out_b, double[::1] out_var,
        double[::1] out_r, double[:, ::1] out_y)

    @cython.locals(i=cython.Py_ssize_t)
    cpdef void write(
        self, Py_ssize_t n, double[:, ::1] out_q, double[:, ::1] out_b, double[::1] out_var, double[::1] out_r,
        double[:, ::1] out_y) noexcept

    @cython.locals(dt=double, n=cython.Py_ssize_t)
    cpdef void skip(
        self, const double[::1] time_s, const double[:, ::1] gyr, const double[:, ::1] acc,
        const unsigned char[::1] flags, const double[::1] r, Py_ssize_t first, Py_ssize_t last)

    @cython.locals(
        errors=Errors, n_rows=cython.Py_ssize_t, dt=double, n=cython.Py_ssize_t, i=cython.Py_ssize_t, j=cython.Py_ssize_t,
        u=cython.Py_ssize_t)
    cpdef Py_ssize_t write_tape(
        self, const double[::1] time_s, const double[:, ::1] gyr, const double[:, ::1] acc,
        const unsigned char[::1] flags, const double[::1] r, Py_ssize_t first, Py_ssize_t last, double[:, ::1] tape,
        Py_ssize_t[:, ::1] marks)
