"""Runs qmt's heading correction, in an environment of its own because qmt needs numpy < 2.

    python qmt_peer.py IN.npz OUT.npz SETTINGS.json

IN holds `NAME.t, NAME.gyr_body, NAME.gyr_lever, NAME.q_body, NAME.q_lever` for any number of recordings; OUT holds
`NAME.SETTING` (n, 4), the corrected attitude of the lever, for every setting of the JSON object. This script imports
nothing of the project.
"""

import json
import sys

import numpy as np
import qmt

AXIS = np.array([1.0, 0.0, 0.0])


def main(source: str, target: str, settings_file: str) -> None:
    with open(settings_file, encoding="utf-8") as file:
        settings = json.load(file)
    given = np.load(source)
    names = sorted({key.rsplit(".", 1)[0] for key in given})
    results = {}
    for name in names:
        gyr_body, gyr_lever, q_body, q_lever = (
            given[f"{name}.{part}"] for part in ("gyr_body", "gyr_lever", "q_body", "q_lever")
        )
        t = given[f"{name}.t"]
        for label, options in settings.items():
            results[f"{name}.{label}"] = qmt.headingCorrection(
                gyr_body, gyr_lever, q_body, q_lever, t, AXIS, {}, options
            )[0]
    np.savez(target, **results)


if __name__ == "__main__":
    main(*sys.argv[1:])
