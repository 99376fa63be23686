"""Fuzz target of the reader: any bytes give a recording or a `RecordingError`, soon and in little memory.

    python tests/fuzz/recording.py 60          # seconds; needs atheris (the extra `fuzz`, Python 3.11)

The small odd files of the tests are the first corpus. The fuzzer prints a finding with its bytes.
"""

from __future__ import annotations

import sys
import tempfile
from pathlib import Path

# Run as a script, this folder's parent holds the odd files.
sys.path.insert(0, str(Path(__file__).parents[1]))

_NAMES = ("a.csv", "a.csv.gz", "a.csv.zst", "a.parquet", "-")
_MAX_INPUT_BYTES = 65_536


def check_bytes(data: bytes, *, name: str) -> None:
    """Raises `AssertionError` or whatever the reader let through, for bytes that it must read or refuse."""
    import numpy as np  # noqa: PLC0415 - after the fuzzer's instrumentation

    import inhalemon as im  # noqa: PLC0415

    refused: im.RecordingError | None = None
    try:
        recording = im.read_recording_bytes(data, name=name, device="pmdi")
    except im.RecordingError as error:
        refused = error
    if refused is not None:
        assert refused.file is not None
        assert refused.file.startswith(name)
        assert refused.line is None or refused.line >= 1
        assert str(refused).isprintable()
        return
    for track in (recording.body, recording.lever):
        assert track.time_s[-1] - track.time_s[0] <= 3600.0
        assert 24.9 < track.rate_hz < 1001.0
        assert (np.diff(track.time_s) > 0).all()
        assert np.isfinite(track.acc_m_s2).all()
        assert np.isfinite(track.gyr_rad_s).all()


def _one_input(data: bytes) -> None:
    """The first byte chooses the file's name, and with it what is expected inside."""
    if data:
        check_bytes(data[1:], name=_NAMES[data[0] % len(_NAMES)])


def main(seconds: int) -> None:
    import atheris  # noqa: PLC0415 - an extra, needed here alone

    with atheris.instrument_imports(include=["inhalemon"]):
        import inhalemon.recording  # noqa: F401, PLC0415

    from odd_recordings import ODD_FILES  # noqa: PLC0415

    with tempfile.TemporaryDirectory() as corpus:
        for number, odd in enumerate(ODD_FILES):
            first = next((i for i, name in enumerate(_NAMES) if odd.name.endswith(name[1:]) and name != "-"), 4)
            if len(odd.data) < _MAX_INPUT_BYTES:
                (Path(corpus) / f"{number:03}").write_bytes(bytes([first]) + odd.data)
        limits = [f"-max_total_time={seconds}", f"-max_len={_MAX_INPUT_BYTES}", "-timeout=10", "-rss_limit_mb=1024"]
        atheris.Setup([sys.argv[0], corpus, *limits, "-print_final_stats=1"], _one_input)
        atheris.Fuzz()


if __name__ == "__main__":
    main(int(sys.argv[1]) if len(sys.argv) > 1 else 60)
