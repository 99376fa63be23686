# C types for _source_kernel.py; it is the same program without them.
cimport cython
from libc cimport math

@cython.final
cdef class SourceFilter:
    cdef public double gyr_var, acc_var, g
    cdef public Py_ssize_t n_window
    cdef public double[4] x
    cdef public double[16] p
    cdef double[9] r
    cdef Py_ssize_t n_seen
    cdef double[3] sum_y
    cdef double[9] sum_yy
    cdef double[9] sum_hph

    @cython.locals(
        x=cython.p_double, p=cython.p_double, r=cython.p_double, f="double[16]", g="double[12]", h="double[12]",
        y="double[3]", k="double[12]", ph="double[12]", hph="double[9]", s="double[9]", work="double[16]",
        dt=double, wx=double, wy=double, wz=double, c=double, n=cython.Py_ssize_t, i=cython.Py_ssize_t,
        j=cython.Py_ssize_t, m=cython.Py_ssize_t)
    cpdef void run(
        self, const double[::1] time_s, const double[:, ::1] gyr, const double[:, ::1] acc, double[:, ::1] window,
        double[:, ::1] out_x, double[::1] out_var, double[::1] out_r)

    @cython.locals(
        n=cython.Py_ssize_t, at=cython.Py_ssize_t, i=cython.Py_ssize_t, j=cython.Py_ssize_t, m=cython.Py_ssize_t)
    cdef void adapt(self, double[:, ::1] window, double* y, double* hph) noexcept

@cython.locals(scale=double, i=cython.Py_ssize_t)
cdef void invert(double* a, double* out) noexcept

@cython.locals(
    v="double[9]", d="double[9]", theta=double, t=double, c=double, s=double, x=double, y=double,
    i=cython.Py_ssize_t, j=cython.Py_ssize_t, m=cython.Py_ssize_t, _sweep=cython.Py_ssize_t)
cdef void raise_eigenvalues(double* a, double floor) noexcept
