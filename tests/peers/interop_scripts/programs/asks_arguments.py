"""argparse, and an exit code of its own."""

import argparse
import sys

import rclpy
import rclpy.utilities


def main(args=sys.argv):
    rclpy.init(args=args)
    parser = argparse.ArgumentParser(prog="asks")
    parser.add_argument("data", nargs="?", default="Hello")
    parser.add_argument("--count", type=int, default=1)
    without = rclpy.utilities.remove_ros_args(args)
    found = parser.parse_args(without[1:])
    node = rclpy.create_node("asks")
    print(found, node.get_name(), node.declare_parameter("p", 0).value)
    rclpy.shutdown()
    return found.count


if __name__ == "__main__":
    sys.exit(main())
