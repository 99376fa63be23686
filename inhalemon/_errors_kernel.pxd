# C types for _errors_kernel.py; it is the same program without them.
# Indices are Py_ssize_t: with a narrower type the compiler cannot turn the loops into vector instructions.
cimport cython

@cython.final
cdef class Errors:
    cdef public Py_ssize_t end
    cdef public double[256] p
    cdef double dt
    cdef double[24] a
    cdef double c, tilt_noise, velocity_noise
    cdef double[16] d
    cdef Py_ssize_t n_updates
    cdef Py_ssize_t[5] i
    cdef double[80] k
    cdef double[5] y
    cdef double[5] s

    @cython.locals(i=cython.Py_ssize_t)
    cdef void take(self, Errors other) noexcept

    @cython.locals(i=cython.Py_ssize_t)
    cdef void gather(self) noexcept

    @cython.locals(
        p=cython.p_double, a=cython.p_double, t="double[16]", u="double[16]", c=double, s00=double, s01=double, s11=double, i=cython.Py_ssize_t,
        j=cython.Py_ssize_t)
    cdef void grow(self, double bias_q) noexcept

    @cython.locals(
        p=cython.p_double, h="double[16]", k="double[16]", h2="double[16]", k2="double[16]", s=double, s2=double, c=double, y2=double,
        i=cython.Py_ssize_t, j=cython.Py_ssize_t)
    cdef void update_velocity(self, double vx, double vy, double var) noexcept

    @cython.locals(
        p=cython.p_double, h="double[16]", k="double[16]", s=double, y=double, j=cython.Py_ssize_t,
        m=cython.Py_ssize_t)
    cdef void update(self, Py_ssize_t i, double error, double var) noexcept
