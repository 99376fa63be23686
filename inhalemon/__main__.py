"""The command line's door: `inhalemon` and `python -m inhalemon`."""

from __future__ import annotations

import gc
import os

# One BLAS and OpenMP thread: arrays here are too short to gain from more, and the same bytes must give the same report
# to the bit. The libraries read these when they are loaded, which is why they are set before anything else.
for _name in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "VECLIB_MAXIMUM_THREADS"):
    os.environ.setdefault(_name, "1")

from inhalemon.cli import run  # noqa: E402 - see above


def main() -> None:
    """Run the command line and leave with its exit code."""
    # The libraries load some 100,000 objects that stay to the end. To look through them for rubbish again and again,
    # and once more on leaving, would be a sixth of the time that one recording takes.
    gc.set_threshold(10_000)
    code = run()
    gc.freeze()
    raise SystemExit(code)


if __name__ == "__main__":
    main()
