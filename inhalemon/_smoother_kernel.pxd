# C types for _smoother_kernel.py; it is the same program without them.
cimport cython
from libc cimport math
from inhalemon._attitude_kernel cimport AttitudeFilter

@cython.final
cdef class Smoother:
    cdef double[8] lam
    cdef double[56] big

    @cython.locals(
        x="double[8]", q="double[4]", row=cython.Py_ssize_t, n=cython.Py_ssize_t, i=cython.Py_ssize_t,
        j=cython.Py_ssize_t, hx=double, hy=double, s=double)
    cpdef void run(
        self, const double[:, ::1] tape, const Py_ssize_t[:, ::1] marks, Py_ssize_t n_rows, double[:, ::1] out_q,
        double[:, ::1] out_b, double[::1] out_var)

    @cython.locals(
        lam=cython.p_double, big=cython.p_double, w="double[8]", n_updates=cython.Py_ssize_t, u=cython.Py_ssize_t,
        at=cython.Py_ssize_t, m=cython.Py_ssize_t, i=cython.Py_ssize_t, j=cython.Py_ssize_t, s=double, c=double)
    cdef void step_back(self, const double[:, ::1] tape, const Py_ssize_t[:, ::1] marks, Py_ssize_t row) noexcept


@cython.locals(turner=AttitudeFilter, i=cython.Py_ssize_t, n=cython.Py_ssize_t)
cpdef void fill(
    const double[::1] time_s, const double[:, ::1] gyr, const unsigned char[::1] is_row, double[:, ::1] out_q,
    double[:, ::1] out_b, double[::1] out_var)

@cython.locals(
    mean_x=double, mean_y=double, mean_yy=double, mean_hph=double, seen_s=double, future=double,
    after=cython.Py_ssize_t, n=cython.Py_ssize_t, g=double)
cpdef void centred_r(
    const double[::1] time_s, const double[:, ::1] y, double window_s, double floor, double largest, double[::1] r)

@cython.locals(
    n=cython.Py_ssize_t, hx=double, hy=double, hz=double, s=double, c=double, qw=double, qx=double, qy=double,
    qz=double)
cpdef void finish(
    const double[:, ::1] gyr, const double[:, ::1] b, double delay_s, double unseen_var, double delay_var,
    double[:, ::1] out_q, double[::1] out_sd)
