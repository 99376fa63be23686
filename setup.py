"""Builds the compiled kernels when there is a C compiler; without one the install goes on and Python runs them."""

from pathlib import Path

from setuptools import Extension, setup

# No fast-math and no contraction: a compiled kernel and its Python form must agree to the bit.
FLAGS = ["-O3", "-ffp-contract=off"]
# Two numbers just written, read back as one vector, stall the processor: a tenth of the attitude filter's time.
MORE_FLAGS = {"_attitude_kernel.py": ["-fno-tree-slp-vectorize"]}
kernels = [
    Extension(
        f"inhalemon.{Path(file).stem}", [f"inhalemon/{file}"], extra_compile_args=FLAGS + MORE_FLAGS.get(file, [])
    )
    for file in (
        "_attitude_kernel.py",
        "_errors_kernel.py",
        "_heading_kernel.py",
        "_loops_kernel.py",
        "_source_kernel.py",
        "_smoother_kernel.py",
        "_csv_kernel.pyx",
    )
]


def extensions() -> list[Extension]:
    try:
        from Cython.Build import cythonize
    except ImportError:
        return []
    directives = {
        "language_level": 3,
        "boundscheck": False,
        "wraparound": False,
        "cdivision": True,
        "annotation_typing": False,
        "initializedcheck": False,
    }
    built: list[Extension] = cythonize(kernels, compiler_directives=directives)
    for extension in built:
        extension.optional = True  # said here, because cythonize makes new extensions and forgets it
    return built


setup(ext_modules=extensions())
