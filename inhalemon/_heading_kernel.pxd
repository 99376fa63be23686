# C types for _heading_kernel.py; it is the same program without them.
cimport cython

cdef extern from "math.h":
    cpdef double remainder(double x, double y) noexcept
    cpdef double sqrt(double x) noexcept

cdef double _WHOLE_TURN

@cython.locals(
    i=cython.Py_ssize_t, dt=double, x=double, rate=double, p00=double, p01=double, p11=double, surprise=double,
    variance=double, excess=double, gain=double, gain_rate=double)
cpdef void filter_heading(
    double[::1] step_s, double[::1] measured_rad, double[::1] shown, double[::1] scatter_rad2,
    double start_rad, double start_var, double rate_var, double walk_var, double min_shown, double max_surprise,
    double[:, ::1] told, double[:, ::1] known)

@cython.locals(
    i=cython.Py_ssize_t, dt=double, p00=double, p01=double, p11=double, t00=double, t01=double, t11=double,
    determinant=double, a=double, c=double, g00=double, g01=double, g10=double, g11=double, dx=double, drate=double,
    e00=double, e01=double, e11=double)
cpdef void smooth_heading(double[::1] step_s, double[:, ::1] told, double[:, ::1] known)
