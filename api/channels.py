"""The curves that a session has: their names, and the order in which they are stored."""

CHANNELS = (
    "time_s",
    "tilt_deg",
    "tilt_sd_deg",
    "angle_deg",
    "angle_sd_deg",
    "off_axis_deg",
    "gyr_x_deg_s",
    "gyr_y_deg_s",
    "gyr_z_deg_s",
    "gyr_norm_deg_s",
    "acc_x_m_s2",
    "acc_y_m_s2",
    "acc_z_m_s2",
    "acc_norm_m_s2",
    "lever_acc_norm_m_s2",
    "r",
    "lever_r",
)
LAYOUT = 2  # raised whenever the channels change: it is part of the cached files' names
DEFAULT = ("tilt_deg", "angle_deg", "gyr_norm_deg_s", "acc_norm_m_s2")
