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
    "commas": lambda poses: tum(poses, separator=",", end="\r\n"),
    "commas, spaces and a byte order mark": lambda poses: "\ufeff" + tum(poses, separator=", "),
    "tabs, a heading and empty lines": lambda poses: tum(
        poses, "time\tx\ty\tz\tqx\tqy\tqz\tqw\n", "\t", "\n\n"
    ),
    "numpy.savetxt": lambda poses: w_first(poses, "# timestamp tx ty tz qw qx qy qz", separator=" "),
    "capitals and quotes": lambda poses: w_first(poses, '"Timestamp","TX","TY","TZ","QW","QX","QY","QZ"'),
    "open_vins": lambda poses: tum(poses, "# timestamp(s) tx ty tz qx qy qz qw Pr11 Pr12 Pr13 Pt11"),
    "EuRoC": lambda poses: w_first(poses, f"#timestamp [ns], {EUROC}", str, more=BIASES),
    "EuRoC's ground truth": lambda poses: w_first(poses, f"#timestamp, {EUROC}", str, more=BIASES),
    "EuRoC with spaces": lambda poses: w_first(
        poses, f"#timestamp [ns] {EUROC.replace(',', '')}", lambda ns: f"{ns}.0000", " ", BIASES
    ),
    "a comma at the end": lambda poses: w_first(
        poses, "#time(ns),px,py,pz,qw,qx,qy,qz,vx,vy", str, more=("1", "2", "")
    ),
    "Newer College": lambda poses: table(
        poses,
        lambda ns, numbers: ",".join(["7", str(ns // S), str(ns % S), *numbers]),
        "# counter, sec, nsec, x, y, z, qx, qy, qz, qw",
    ),
    "fields of messages": lambda poses: table(
        poses,
        lambda ns, numbers: ",".join(["a b", str(ns), *numbers]),
        "header.frame_id,header.stamp [ns],pose.pose.position.x,pose.pose.position.y,pose.pose.position.z,"
        "pose.pose.orientation.x,pose.pose.orientation.y,pose.pose.orientation.z,pose.pose.orientation.w",
    ),
    "milliseconds and kilometers": lambda poses: table(
        poses,
        lambda ns, numbers: " ".join(
            [
                f"{ns // 10**6}.{ns % 10**6:06d}",
                *(repr(float(one) / 1000) for one in numbers[:3]),
                *numbers[3:],
            ]
        ),
        "# format: t [ms] x [km] y [km] z [km] qx qy qz qw",
    ),
}


def shuffled(poses, order, dice):
    """
    A file with a heading whose columns have another order.

    :param order: a permutation of the 11 columns, of which three are not needed.
    :param dice: a random.Random, which chooses among the names.
    """
    stamp = dice.choice(
        [
            "timestamp",
            "time",
            "t",
            "ts",
            "stamp",
            "Time [s]",
            "timestamp(s)",
            "stamp_ns",
            "t[ms]",
            "time (us)",
        ]
    )
    style = dice.choice(["{}", "t{}", "p{}", "p_{}", "pos_{}", "position.{}", "p_W_{} [m]", "{}(m)"])
    turn = dice.choice(["q{}", "q_{}", "q.{}", "quat_{}", "orientation.{}", "q_WB_{} []"])
    names = [stamp, *(style.format(axis) for axis in "xyz"), *(turn.format(axis) for axis in "xyzw")]
    names += ["frame", "vx [m s^-1]", "cov"]
    unit = 1 if "ns" in stamp else 1_000 if "us" in stamp else 10**6 if "ms" in stamp else S
    separator = dice.choice([",", ", ", " ", "\t"])

    def line(texts):
        return separator.join(texts[i] for i in order)

    def row(ns, numbers):
        whole, rest = divmod(ns, unit)
        exact = f"{whole}.{rest:0{len(str(unit)) - 1}d}" if unit > 1 else str(ns)
        return line([exact, *numbers, "base", "nan", "0.5"])

    heading = line(names if "," in separator else [one.replace(" s^-1", "") for one in names])
    return table(poses, row, dice.choice(["", "#", "# "]) + heading)
