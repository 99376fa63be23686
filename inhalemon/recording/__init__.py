"""The recording file: read and written strictly, so that nothing wrong is scored in silence."""

from inhalemon.recording.identity import session_id_of
from inhalemon.recording.motion_bids import write_motion_bids
from inhalemon.recording.reader import is_recording_file, read_recording, read_recording_bytes
from inhalemon.recording.writer import write_recording

__all__ = [
    "is_recording_file",
    "read_recording",
    "read_recording_bytes",
    "session_id_of",
    "write_motion_bids",
    "write_recording",
]
