# C types for _loops_kernel.py; it is the same program without them.
cimport cython

@cython.locals(
    last=cython.Py_ssize_t, i=cython.Py_ssize_t, j=cython.Py_ssize_t, k=cython.Py_ssize_t, at=double, h=double,
    share_0=double, share_1=double, u=double, rise=double, tangent_0=double, tangent_1=double, c_2=double, c_3=double)
cpdef void interpolate(
    const double[::1] time_s, const double[:, ::1] values, const double[::1] at_s, double[:, ::1] found,
    double[:, ::1] slope, Py_ssize_t[::1] place)

@cython.locals(
    n=cython.Py_ssize_t, n_labels=cython.Py_ssize_t, i=cython.Py_ssize_t, label=cython.Py_ssize_t,
    before=cython.Py_ssize_t, after=cython.Py_ssize_t, best=cython.Py_ssize_t, least=double, cost=double)
cpdef void cheapest_path(double[:, ::1] totals, const double[:, ::1] transitions, Py_ssize_t[::1] path)

@cython.locals(i=cython.Py_ssize_t, row=cython.Py_ssize_t, k=cython.Py_ssize_t, apart=double)
cpdef Py_ssize_t first_far(
    const double[:, ::1] points, Py_ssize_t n_columns, Py_ssize_t here, Py_ssize_t first, Py_ssize_t stop,
    Py_ssize_t step, double square)

@cython.locals(i=cython.Py_ssize_t, row=cython.Py_ssize_t, k=cython.Py_ssize_t, apart=double)
cpdef Py_ssize_t first_near(
    const double[:, ::1] points, Py_ssize_t n_columns, Py_ssize_t here, Py_ssize_t first, Py_ssize_t stop,
    Py_ssize_t step, double square)

@cython.locals(
    n_turns=cython.Py_ssize_t, low=cython.Py_ssize_t, high=cython.Py_ssize_t, direction=cython.Py_ssize_t,
    i=cython.Py_ssize_t, last=cython.Py_ssize_t)
cpdef Py_ssize_t turning_points(const double[::1] values, double least, Py_ssize_t[::1] turns)

@cython.locals(
    last=cython.Py_ssize_t, i=cython.Py_ssize_t, j=cython.Py_ssize_t, k=cython.Py_ssize_t, since=double)
cpdef void integrate(
    const double[::1] time_s, const double[:, ::1] values, Py_ssize_t n_columns, const double[::1] at_s,
    double[::1] total, double[:, ::1] found)

@cython.locals(n=cython.Py_ssize_t, k=cython.Py_ssize_t, i=cython.Py_ssize_t)
cpdef void moving_means(
    const double[:, ::1] values, Py_ssize_t before, Py_ssize_t after, double[::1] sums, double[:, ::1] means)

@cython.locals(
    last=cython.Py_ssize_t, i=cython.Py_ssize_t, j=cython.Py_ssize_t, k=cython.Py_ssize_t, at=double, slope=double)
cpdef void straight(
    const double[::1] time_s, const double[:, ::1] values, const double[::1] at_s, double[:, ::1] found)
