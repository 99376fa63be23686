"""Rows of plain CSV text to doubles, for `recording/csv_table.py`, which does the same without it, only slower."""

from libc.string cimport memcmp

# Ten to these powers are doubles without an error.
cdef double[23] POWERS = [
    1e0, 1e1, 1e2, 1e3, 1e4, 1e5, 1e6, 1e7, 1e8, 1e9, 1e10, 1e11,
    1e12, 1e13, 1e14, 1e15, 1e16, 1e17, 1e18, 1e19, 1e20, 1e21, 1e22,
]
cdef unsigned long long LARGEST_EXACT = 1ULL << 53


def parse_rows(
    const unsigned char[::1] text,
    Py_ssize_t sensor_column,
    Py_ssize_t max_line,
    double[:, ::1] values,
    unsigned char[::1] is_lever,
):
    """Fills `values` (n, columns; 0 for the sensor) and `is_lever` (n,) from n rows of text that ends with a line end.

    Returns whether all rows were plain: `body` or `lever`, and numbers as JSON has them, of few enough digits that one
    multiplication or division by a power of ten rounds correctly (Clinger 1990, doi:10.1145/93542.93557).
    """
    cdef Py_ssize_t n_rows = values.shape[0], n_columns = values.shape[1], n_bytes = text.shape[0]
    cdef Py_ssize_t row, column, start = 0
    cdef const unsigned char* at
    cdef const unsigned char* line
    cdef const unsigned char* end
    cdef unsigned char wanted
    if n_rows == 0 or n_bytes == 0 or text[n_bytes - 1] != c"\n" or is_lever.shape[0] != n_rows:
        return False
    at = &text[0]
    end = at + n_bytes
    for row in range(n_rows):
        line = at
        for column in range(n_columns):
            if column == sensor_column:
                if end - at > 4 and memcmp(at, b"body", 4) == 0:
                    is_lever[row] = 0
                    at += 4
                elif end - at > 5 and memcmp(at, b"lever", 5) == 0:
                    is_lever[row] = 1
                    at += 5
                else:
                    return False
                values[row, column] = 0.0
            else:
                at = number(at, &values[row, column])
                if at == NULL:
                    return False
            # Every reading above stops at the line end that ends the text, if not before.
            wanted = c"\n" if column == n_columns - 1 else c","
            if at[0] != wanted:
                return False
            at += 1
            if at == end and not (row == n_rows - 1 and column == n_columns - 1):
                return False
        if at - line > max_line:
            return False
    return at == end


cdef const unsigned char* number(const unsigned char* at, double* value) noexcept nogil:
    """Reads a number; returns where it ends, or NULL when it is not plain."""
    cdef unsigned long long mantissa = 0
    cdef int n_digits = 0, power = 0, exponent = 0
    cdef bint is_negative = at[0] == c"-", is_exponent_negative = False
    cdef const unsigned char* first
    if is_negative:
        at += 1
    first = at
    while c"0" <= at[0] <= c"9":
        mantissa = mantissa * 10 + (at[0] - c"0")
        at += 1
    n_digits = <int>(at - first) if at - first < 20 else 20
    if n_digits == 0 or (first[0] == c"0" and n_digits > 1):
        return NULL
    if at[0] == c".":
        at += 1
        first = at
        while c"0" <= at[0] <= c"9":
            mantissa = mantissa * 10 + (at[0] - c"0")
            at += 1
            power -= 1
        if at == first:
            return NULL
        n_digits += -power
    if at[0] == c"e" or at[0] == c"E":
        at += 1
        is_exponent_negative = at[0] == c"-"
        if at[0] == c"-" or at[0] == c"+":
            at += 1
        first = at
        while c"0" <= at[0] <= c"9" and at - first < 5:
            exponent = exponent * 10 + (at[0] - c"0")
            at += 1
        if at == first:
            return NULL
        power += -exponent if is_exponent_negative else exponent
    # Up to 19 digits cannot have overflowed 64 bits; leading zeros count too, which only makes it stricter.
    if n_digits > 19 or mantissa > LARGEST_EXACT or power < -22 or power > 22:
        return NULL
    if power < 0:
        value[0] = mantissa / POWERS[-power]
    else:
        value[0] = mantissa * POWERS[power]
    if is_negative:
        value[0] = -value[0]
    return at
