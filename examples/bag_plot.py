"""Plot fields of a recorded topic over time: python examples/bag_plot.py drive /imu angular_velocity.z -o imu.png

A bag is a folder or a file, of rosbag2 or ``rosidl-py bag record``; the types in it need not be installed. Every field
gets a plot of its own. Needs ``pip install ".[mcap]" matplotlib``. Seen:

    300 messages of /imu, 2.990 s, in imu.png
"""

import argparse

import numpy as np
from matplotlib.figure import Figure
from numpy.typing import NDArray

from rosidl_py_gen import RosidlError
from rosidl_py_gen.bags import BagReader


def plotted(table: NDArray[np.void], topic: str) -> Figure:
    """A figure with a plot below the other for each column but the first, which is the time."""
    names = (table.dtype.names or ())[1:]
    seconds = (table["log_time"] - table["log_time"][0]) / 1e9
    figure = Figure(figsize=(8, 0.8 + 1.6 * len(names)), layout="constrained")
    figure.suptitle(topic)
    axes = figure.subplots(len(names), sharex=True, squeeze=False)[:, 0]
    for name, plot in zip(names, axes, strict=True):
        plot.plot(seconds, table[name], linewidth=1)
        plot.set_ylabel(name)
        plot.grid(alpha=0.3)
    axes[-1].set_xlabel("seconds")
    return figure


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("bag")
    parser.add_argument("topic")
    parser.add_argument(
        "fields", nargs="+", help="paths such as angular_velocity.z, position[1]; ranges[0:9] gives lines"
    )
    parser.add_argument("-o", "--output", default="plot.png", help="PNG, SVG or PDF, by its ending")
    wanted = parser.parse_args()
    try:
        with BagReader(wanted.bag) as bag:
            table = bag.to_arrays(wanted.topic, wanted.fields, pad=np.nan)  # a sequence may be shorter
    except (RosidlError, OSError) as error:
        raise SystemExit(f"error: {error}") from None
    if not len(table):
        raise SystemExit(f"error: {wanted.bag} has no messages on {wanted.topic}")
    plotted(table, wanted.topic).savefig(wanted.output)
    seconds = (table["log_time"][-1] - table["log_time"][0]) / 1e9
    print(f"{len(table)} messages of {wanted.topic}, {seconds:.3f} s, in {wanted.output}")


if __name__ == "__main__":
    main()
