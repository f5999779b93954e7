# SPDX-FileCopyrightText: tf2-ros-cython contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Poses as programs write them: each form is a function that makes the text of a file."""

import numpy as np

from tf2_ros.numpy import to_matrix

S = 1_000_000_000


class Poses:
    """
    Poses with stamps.

    `times_ns`: N numbers; `translations`, `rotations`: arrays of shape (N, 3) and (N, 4).
    """

    def __init__(self, times_ns, translations, rotations):
        self.times_ns = [int(ns) for ns in times_ns]
        self.translations, self.rotations = np.array(translations, float), np.array(rotations, float)

    def rows(self):
        """The stamp in ns, and the numbers x y z qx qy qz qw with all their digits."""
        for ns, xyz, xyzw in zip(self.times_ns, self.translations, self.rotations, strict=True):
            yield ns, [*map(repr, [*xyz.tolist(), *xyzw.tolist()])]

    def matrices(self):
        return to_matrix((self.translations, self.rotations))


def seconds(ns):
    return f"{ns // S}.{ns % S:09d}"


def table(poses, row, heading="", end="\n"):
    """`row`: makes a line of a stamp in ns and the numbers x y z qx qy qz qw."""
    return "".join(
        f"{line}{end}" for line in [*filter(None, [heading]), *(row(*one) for one in poses.rows())]
    )


def tum(poses, heading="", separator=" ", end="\n"):
    return table(poses, lambda ns, numbers: separator.join([seconds(ns), *numbers]), heading, end)


def w_first(poses, heading, stamp=seconds, separator=",", more=()):
    def row(ns, numbers):
        return separator.join([stamp(ns), *numbers[:3], numbers[6], *numbers[3:6], *more])

    return table(poses, row, heading)


def kitti(poses, digits=17):
    matrices = poses.matrices()[:, :3].reshape(-1, 12)
    return "".join(" ".join(f"{one:.{digits}e}" for one in matrix) + "\n" for matrix in matrices)


EUROC = (
    "p_RS_R_x [m], p_RS_R_y [m], p_RS_R_z [m], q_RS_w [], q_RS_x [], q_RS_y [], q_RS_z [], v_RS_R_x [m s^-1],"
    " b_w_RS_S_x [rad s^-1], b_a_RS_S_x [m s^-2]"
)
BIASES = ("0.1", "-0.2", "nan")

# Those whose numbers have all digits.
FORMS = {
    "TUM": lambda poses: tum(poses, "# ground truth\n# file: 'a.bag'\n# timestamp tx ty tz qx qy qz qw"),
    "TUM without comments": tum,
    "TUM, reversed": lambda poses: "\n".join(tum(poses).splitlines()[::-1]),
    "TUM, a byte order mark and tabs": lambda poses: "\ufeff" + tum(poses, separator="\t", end="\r\n"),
    "semicolons": lambda poses: tum(poses, "time;x;y;z;qx;qy;qz;qw", "; "),
    "tabs, a heading and empty lines": lambda poses: tum(
        poses, "time\tx\ty\tz\tqx\tqy\tqz\tqw\n", "\t", "\n\n"
    ),
    "tabs, and an empty field": lambda poses: table(
        poses,
        lambda ns, numbers: "\t".join([seconds(ns), "", *numbers, "0"]),
        "time\tname of a place\tx\ty\tz\tqx\tqy\tqz\tqw\tfloor",
    ),
    "numpy.savetxt": lambda poses: w_first(poses, "# timestamp tx ty tz qw qx qy qz", separator=" "),
    "capitals and quotes": lambda poses: w_first(poses, '"Timestamp","TX","TY","TZ","QW","QX","QY","QZ"'),
    "EuRoC": lambda poses: w_first(poses, f"#timestamp [ns], {EUROC}", str, more=BIASES),
    "EuRoC's ground truth": lambda poses: w_first(poses, f"#timestamp, {EUROC}", str, more=BIASES),
    "EuRoC with spaces": lambda poses: w_first(
        poses, f"#timestamp [ns] {EUROC.replace(',', '')}", lambda ns: f"{ns}.0000", " ", BIASES
    ),
    "Newer College": lambda poses: table(
        poses,
        lambda ns, numbers: ",".join(["7", str(ns // S), str(ns % S), *numbers]),
        "# counter, sec, nsec, x, y, z, qx, qy, qz, qw",
    ),
    "a label first, and milliseconds": lambda poses: table(
        poses,
        lambda ns, numbers: ",".join(["slam", f"{ns // 10**6}.{ns % 10**6:06d}", *numbers]),
        "label,time_ms,x,y,z,qx,qy,qz,qw",
    ),
}


def open_vins(poses, more=()):
    heading = (
        "# timestamp(s) tx ty tz qx qy qz qw Pr11 Pr12 Pr13 Pr22 Pr23 Pr33 Pt11 Pt12 Pt13 Pt22 Pt23 Pt33"
    )
    return table(poses, lambda ns, numbers: " ".join([seconds(ns), *numbers, *more]), heading)


# Those of the page, which names their columns: each with and without what the program may add.
ON_PAGE = {
    "OpenVINS's `pose_to_file`": [open_vins, lambda poses: open_vins(poses, ["0.1"] * 12)],
    "ORB-SLAM3 in ns": [lambda poses: table(poses, lambda ns, numbers: " ".join([f"{ns}.000000", *numbers]))],
    "VINS": [
        lambda poses: w_first(poses, "", str, more=[""]),
        lambda poses: w_first(poses, "", str, more=["0.1", "0.2", "0.3", ""]),
    ],
    "`ros2 topic echo --csv`, `PoseStamped`": [
        lambda poses: table(poses, lambda ns, numbers: ",".join([str(ns // S), str(ns % S), "map", *numbers]))
    ],
}


def shuffled(poses, order, dice):
    """
    A file with a heading whose columns have another order.

    :param order: a permutation of the 11 columns, of which three are not needed.
    :param dice: a random.Random, which chooses among the names.
    """
    stamps = ["timestamp", "time", "t", "stamp", "Time [s]", "timestamp(s)", "stamp_ns", "t[ms]", "time (us)"]
    stamp = dice.choice(stamps)
    style = dice.choice(["{}", "t{}", "p{}", "p_{}", "pos_{}", "position.{}", "p_RS_R_{} [m]", "{}(m)"])
    turn = dice.choice(["q{}", "q_{}", "q.{}", "quat_{}", "orientation.{}", "q_RS_{} []"])
    names = [stamp, *(style.format(axis) for axis in "xyz"), *(turn.format(axis) for axis in "xyzw")]
    names += ["frame", "vx [m s^-1]", "cov"]
    unit = 1 if "ns" in stamp else 1_000 if "us" in stamp else 10**6 if "ms" in stamp else S
    separator = dice.choice([",", ", ", " ", "\t", ";"])

    def line(texts):
        return separator.join(texts[i] for i in order)

    def row(ns, numbers):
        whole, rest = divmod(ns, unit)
        exact = f"{whole}.{rest:0{len(str(unit)) - 1}d}" if unit > 1 else str(ns)
        return line([exact, *numbers, "base", "nan", "0.5"])

    return table(poses, row, dice.choice(["", "#", "# "]) + line(names))
